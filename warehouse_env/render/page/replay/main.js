// From the data in the page to the running app.

async function readReplays(about) {
  const texts = [...document.querySelectorAll("script.data")];
  return Promise.all(about.replays.map(async (one, k) => {
    const episode = new Episode(one, readColumns(one.packed, await inflate(texts[k].textContent)), about.flags);
    texts[k].remove();
    dress(episode, about.colours.robots);
    episode.events = findEvents(episode);
    episode.waiting = countWaiting(episode);
    return episode;
  }));
}

// #t=12.5&robot=3&play: where to begin.
function readAddress(app) {
  const given = new URLSearchParams(location.hash.slice(1));
  if (given.has("t")) app.seek(Math.round(Number(given.get("t")) / app.seconds) || 0);
  if (given.has("robot")) app.choose(Math.trunc(Number(given.get("robot"))) || 0);
  if (given.has("play")) app.playing = true;
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

async function start() {
  const about = JSON.parse(document.querySelector("#about").textContent);
  const replays = await readReplays(about);
  buildFloors(replays);
  const app = new Player(about, replays);
  buildPlayer(app);
  buildTotals(app);
  buildTimeline(app);
  build(app);
  app.choose(-1);
  readAddress(app);
  document.querySelector("#loading").remove();
  publish(app);
  run(app);
}

start().catch((error) => {
  document.querySelector("#loading").textContent =
    `This replay cannot be shown: ${error.message}. It needs a browser of 2023 or later.`;
  throw error;
});
