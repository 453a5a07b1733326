// From the data in the page to the running app.

const PANEL_EVERY = 80; // [ms] between two pictures of the side panel while it plays

async function readReplays(about) {
  const texts = [...document.querySelectorAll("script.data")];
  return Promise.all(about.replays.map(async (one, k) => {
    const episode = new Episode(one, readColumns(one.packed, await inflate(texts[k].textContent)), about.flags);
    texts[k].remove();
    episode.colours = about.colours.robots.slice(0, episode.robots);
    episode.edges = episode.colours.map((colour) => mixed(colour, "#000000", 0.55));
    episode.shapes = shapesOf(episode.body);
    episode.events = findEvents(episode);
    episode.waiting = countWaiting(episode);
    return episode;
  }));
}

// A colour #rrggbb with a share of another.
function mixed(colour, other, share) {
  const parts = [1, 3, 5].map((at) => {
    const [a, b] = [colour, other].map((one) => parseInt(one.slice(at, at + 2), 16));
    return Math.round(a + (b - a) * share).toString(16).padStart(2, "0");
  });
  return `#${parts.join("")}`;
}

function buildFloors(replays) {
  const holder = document.querySelector("#floors");
  for (const [k, episode] of replays.entries()) {
    const figure = element("figure", "floor");
    const caption = element("figcaption");
    const dot = element("i", "dot");
    dot.style.background = `var(--series-${k})`;
    caption.append(dot, element("b", "", episode.name), element("span", "", episode.about));
    const canvas = element("canvas");
    canvas.setAttribute("role", "img");
    canvas.setAttribute("aria-label", `the floor with the robots of ${episode.name}`);
    figure.append(canvas, caption);
    holder.append(figure);
  }
  holder.classList.toggle("two", replays.length > 1);
}

function buildLegend(app) {
  for (const canvas of document.querySelectorAll("#legend canvas")) {
    sizeCanvas(canvas);
    const context = canvas.getContext("2d");
    const ratio = canvas.ratio;
    context.clearRect(0, 0, canvas.width, canvas.height);
    const style = { ...styleOf(canvas, app.replays[0], app), ratio };
    drawSign(context, canvas.dataset.sign, canvas.width / 2, canvas.height / 2, 0.42 * canvas.height, style);
  }
}

// #t=12.5&robot=3&play: where to begin.
function readAddress(app) {
  const given = new URLSearchParams(location.hash.slice(1));
  if (given.has("t")) app.seek(Math.round(Number(given.get("t")) / app.seconds) || 0);
  if (given.has("robot")) app.choose(Math.trunc(Number(given.get("robot"))) || 0);
  if (given.has("play")) app.playing = true;
}

function run(app) {
  let before = performance.now(), panelAt = 0;
  const tick = (now) => {
    const passed = Math.min(now - before, 100);
    before = now;
    if (app.playing && !app.scrubbing) {
      app.frame = Math.min(app.frame + (passed * app.speed) / (1000 * app.seconds), app.last);
      if (app.frame >= app.last) app.playing = false;
      app.changed = true;
    }
    if (app.changed) {
      const all = !app.playing || now - panelAt > PANEL_EVERY;
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
  const shown = (panel) => {
    const episode = app.replays[panel];
    episode.goTo((app.frame * app.seconds) / episode.seconds);
    return episode;
  };
  const robots = (panel = 0) => {
    const episode = shown(panel);
    return Array.from({ length: episode.robots }, (_, i) => {
      const [x, y, heading, speed, steer] = episode.now.subarray(5 * i, 5 * i + 5);
      return { x, y, heading, speed, steer };
    });
  };
  const people = (panel = 0) => {
    const episode = shown(panel);
    return Array.from({ length: episode.people }, (_, i) => {
      const [x, y, heading] = episode.walking.subarray(3 * i, 3 * i + 3);
      return { x, y, heading };
    });
  };
  window.replay = {
    app, robots, people,
    frame: () => app.frame,
    frames: () => app.last + 1,
    seek: (frame) => app.seek(frame),
    play: () => app.change({ playing: true }),
    pause: () => app.change({ playing: false }),
    playing: () => app.playing,
    choose: (robot) => app.choose(robot),
    lidar: (robot, panel = 0) => [...lidarOf(app.replays[panel], robot)],
    events: (panel = 0) => app.replays[panel].events,
    totals: (panel = 0) => TOTALS.map((_, k) => app.replays[panel].total(k, app.replays[panel].moment)),
  };
}

// Keep canvases as large as they are shown, and the whole floor in view where it was.
function watchSizes(app) {
  let size = "";
  const watch = new ResizeObserver(() => {
    const [canvas] = app.canvases;
    const now = `${canvas.clientWidth} ${canvas.clientHeight}`;
    const whole = app.view.scale <= app.view.least * 1.001;
    if (now !== size && whole && !app.following) app.fit();
    size = now;
    sizesChanged();
    app.changed = true;
  });
  for (const place of ["#floors", "aside", "#charts"]) watch.observe(document.querySelector(place));
}

async function start() {
  const about = JSON.parse(document.querySelector("#about").textContent);
  const replays = await readReplays(about);
  buildFloors(replays);
  const app = new App(about, replays);
  const dark = matchMedia("(prefers-color-scheme: dark)");
  buildButtons(app);
  buildKeys(app);
  buildTotals(app);
  buildTimeline(app);
  app.canvases.forEach((canvas, k) => buildPointer(app, canvas, k));
  app.theme(dark.matches);
  dark.addEventListener("change", () => app.theme(dark.matches));
  app.fit();
  app.choose(about.robot ?? -1);
  readAddress(app);
  watchSizes(app);
  document.querySelector("#loading").remove();
  buildLegend(app);
  document.querySelector("#legend").addEventListener("toggle", () => {
    sizesChanged();
    buildLegend(app);
  });
  const themed = app.theme.bind(app);
  app.theme = (isDark) => {
    themed(isDark);
    buildLegend(app);
  };
  publish(app);
  run(app);
}

start().catch((error) => {
  document.querySelector("#loading").textContent =
    `This replay cannot be shown: ${error.message}. It needs a browser of 2023 or later.`;
  throw error;
});
