// What is shown now, and everything that changes it. One object; `changed` asks for a new picture.

class App {
  constructor(about, replays) {
    Object.assign(this, { replays, colours: about.colours, terms: about.terms, layers: { ...about.layers } });
    const finest = replays.reduce((a, b) => (a.seconds <= b.seconds ? a : b));
    this.seconds = finest.seconds; // between two moments
    this.every = finest.every; // steps between them
    this.last = Math.round(Math.max(...replays.map((episode) => episode.last * episode.seconds)) / this.seconds);
    Object.assign(this, { frame: 0, playing: false, speed: 4, active: 0, robot: -1, following: false });
    Object.assign(this, { chartSeconds: 60, changed: true, view: new View(), timePicture: null });
    this.still = matchMedia("(prefers-reduced-motion: reduce)").matches;
    this.canvases = [...document.querySelectorAll(".floor canvas")];
  }

  change(what) {
    Object.assign(this, what);
    this.changed = true;
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

  choose(robot, active = this.active) {
    const most = this.replays[active].robots;
    const chosen = robot < -1 ? most - 1 : robot >= most ? -1 : robot;
    this.change({ robot: chosen, active, following: this.following && chosen >= 0 });
    buildCharts(this);
  }

  // Choose the robot of this number and follow it; false if there is none.
  find(text) {
    const robot = /^\s*\d+\s*$/.test(text) ? Number(text) : -1;
    if (robot < 0 || robot >= this.replays[this.active].robots) return false;
    this.choose(robot);
    this.follow(true);
    return true;
  }

  chooseAt(index, px, py) {
    const canvas = this.canvases[index];
    const x = this.view.x + (px - canvas.clientWidth / 2) / this.view.scale;
    const y = this.view.y - (py - canvas.clientHeight / 2) / this.view.scale;
    let best = -1, least = Math.max(0.7, 18 / this.view.scale);
    for (let i = 0; i < this.replays[index].robots; i++) {
      const [cx, cy] = this.replays[index].centre(i);
      const far = Math.hypot(cx - x, cy - y);
      if (far < least) [best, least] = [i, far];
    }
    this.choose(best, index);
  }

  follow(on) {
    if (this.robot < 0) return;
    this.change({ following: on });
    if (on) this.view.scale = Math.max(this.view.scale, 32);
  }

  layer(name) {
    this.layers[name] = !this.layers[name];
    this.changed = true;
  }

  zoom(factor, px = 0, py = 0) {
    this.view.zoom(factor, this.following ? 0 : px, this.following ? 0 : py);
    this.changed = true;
  }

  pan(dx, dy) {
    this.view.pan(dx, dy);
    this.change({ following: false });
  }

  fit() {
    const [canvas] = this.canvases;
    this.view.fit(this.replays[0], canvas.clientWidth, canvas.clientHeight);
    this.change({ following: false });
  }

  help() {
    const dialog = document.querySelector("#help");
    if (dialog.open) dialog.close();
    else dialog.showModal();
  }

  theme(dark) {
    document.documentElement.dataset.theme = dark ? "dark" : "light";
    const style = getComputedStyle(document.documentElement);
    const read = (name) => style.getPropertyValue(name).trim();
    const css = {
      ink: read("--ink"), line: read("--line"), accent: read("--accent"), waitingShare: read("--waiting-share"),
      series: [read("--series-0"), read("--series-1")], levels: [0, 1, 2, 3].map((k) => read(`--level-${k}`)),
    };
    this.change({ dark, css, timePicture: null });
  }

  // Draw everything as it is now.
  draw(all = true) {
    for (const episode of this.replays) episode.goTo((this.frame * this.seconds) / episode.seconds);
    if (this.following) [this.view.x, this.view.y] = this.replays[this.active].centre(this.robot);
    this.canvases.forEach((canvas, k) => drawStage(canvas, this.replays[k], this));
    drawTimeline(this);
    document.querySelector("#clock").textContent = `${(this.frame * this.seconds).toFixed(1)} s`;
    if (!all) return;
    sayTime(this);
    showControls(this);
    showTotals(this);
    showRobot(this);
    showCharts(this);
  }
}
