// From the first message to the running page.

const PANEL_EVERY = 100; // [ms] between two pictures of the side panel

function open(about, message) {
  const app = new LiveApp(about, message);
  buildFleet(app);
  buildSteering(app);
  build(app);
  app.choose(-1);
  publish(app);
  run(app);
  return app;
}

function run(app) {
  let before = performance.now(), panelAt = 0;
  const tick = (now) => {
    app.advance(Math.min(now - before, 250) / 1000);
    before = now;
    if (app.changed) {
      const all = now - panelAt > PANEL_EVERY || !app.pace.playing;
      if (all) panelAt = now;
      app.changed = false;
      app.draw(all);
    }
    requestAnimationFrame(tick);
  };
  requestAnimationFrame(tick);
}

// What tests and other programs may use.
function publish(app) {
  window.live = {
    app,
    robots: () => app.episode.robots,
    seconds: () => app.episode.begin + app.frame * app.seconds,
    goals: () => app.episode.total(0, app.last),
    pace: () => app.pace,
  };
}

function start() {
  const about = JSON.parse(document.querySelector("#about").textContent);
  let app = null;
  const heard = (message) => {
    if (message.kind === "world") {
      if (app) app.renew(message);
      else {
        buildFloors([message]);
        app = open(about, message);
      }
      showWorld(app);
    } else if (!app) return;
    else if (message.kind === "moments") app.hear(message);
    else {
      app.pace = message;
      app.changed = true;
      showPace(app);
    }
  };
  listen(heard, showMaking);
}

start();
