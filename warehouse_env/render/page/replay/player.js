// Going through episodes in time: play, seek, step; the keys, buttons and numbers of that.

const SPEEDS = [0.25, 0.5, 1, 2, 4, 8, 16];

const PLAYER_KEYS = [
  { keys: [" ", "k"], shown: "Space", says: "play or pause", act: (app) => app.toggle() },
  { keys: ["ArrowLeft"], shown: "←", says: "step back", act: (app) => app.step(-1) },
  { keys: ["ArrowRight"], shown: "→", says: "step forward", act: (app) => app.step(1) },
  { keys: ["Shift+ArrowLeft"], shown: "Shift ←", says: "5 s back", act: (app) => app.step(-5 / app.seconds) },
  { keys: ["Shift+ArrowRight"], shown: "Shift →", says: "5 s on", act: (app) => app.step(5 / app.seconds) },
  { keys: ["Home"], shown: "Home", says: "to the start", act: (app) => app.seek(0) },
  { keys: ["End"], shown: "End", says: "to the end", act: (app) => app.seek(app.last) },
  { keys: ["[", "p"], shown: "[", says: "previous event", act: (app) => app.toEvent(-1) },
  { keys: ["]", "e"], shown: "]", says: "next event", act: (app) => app.toEvent(1) },
  { keys: ["ArrowUp"], shown: "↑", says: "faster", act: (app) => app.faster(1) },
  { keys: ["ArrowDown"], shown: "↓", says: "slower", act: (app) => app.faster(-1) },
];

class Player extends App {
  constructor(about, replays) {
    super(about, replays);
    const finest = replays.reduce((a, b) => (a.seconds <= b.seconds ? a : b));
    this.seconds = finest.seconds; // between two moments
    this.every = finest.every; // steps between them
    this.last = Math.round(Math.max(...replays.map((episode) => episode.last * episode.seconds)) / this.seconds);
    Object.assign(this, { playing: false, speed: 4, timePicture: null });
  }

  seek(frame) {
    this.change({ frame: Math.min(Math.max(frame, 0), this.last) });
  }

  step(count) {
    this.playing = false;
    this.seek(Math.round(this.frame) + Math.round(count));
  }

  toggle() {
    if (!this.playing && this.frame >= this.last) this.frame = 0;
    this.change({ playing: !this.playing });
  }

  // Go on by so many seconds of ours.
  advance(seconds) {
    if (!this.playing || this.scrubbing) return;
    this.seek(this.frame + (seconds * this.speed) / this.seconds);
    this.playing = this.frame < this.last;
  }

  faster(by) {
    const k = Math.min(Math.max(SPEEDS.indexOf(this.speed) + by, 0), SPEEDS.length - 1);
    this.change({ speed: SPEEDS[k] });
  }

  // To the event before (-1) or after (1) this moment, of any of the episodes.
  toEvent(way) {
    const frames = this.replays.flatMap((episode) =>
      episode.events.map((event) => Math.round((event.frame * episode.seconds) / this.seconds)),
    );
    const found = frames.filter((frame) => way * (frame - this.frame) > 0.5);
    this.playing = false;
    if (found.length) this.seek(way > 0 ? Math.min(...found) : Math.max(...found));
  }

  theme(dark) {
    super.theme(dark);
    this.timePicture = null;
  }

  // Draw everything as it is now.
  draw(all = true) {
    this.drawFloors();
    drawTimeline(this);
    document.querySelector("#clock").textContent = `${(this.frame * this.seconds).toFixed(1)} s`;
    if (!all) return;
    sayTime(this);
    showPlayer(this);
    showLayers(this);
    showTotals(this);
    showRobot(this);
    showCharts(this);
  }
}

function buildPlayer(app) {
  buildButtons(app, {
    play: () => app.toggle(), back: () => app.step(-1), on: () => app.step(1),
    before: () => app.toEvent(-1), after: () => app.toEvent(1),
  });
  buildKeys(app, [...PLAYER_KEYS, ...KEYS]);
  const speed = document.querySelector("#speed");
  for (const value of SPEEDS) speed.add(new Option(`${value}×`, value, value === app.speed, value === app.speed));
  speed.addEventListener("change", () => (app.speed = Number(speed.value)));
}

function showPlayer(app) {
  const play = document.querySelector("#play");
  play.classList.toggle("playing", app.playing);
  play.setAttribute("aria-label", app.playing ? "pause" : "play");
  document.querySelector("#length").textContent = `of ${(app.last * app.seconds).toFixed(1)} s, step ${Math.floor(app.frame * app.every + 1e-6)}`;
  document.querySelector("#speed").value = app.speed;
}
