// From the first message to the running page.

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
