// What is shown now, and everything that changes it. One object; `changed` asks for a new picture.

const PANEL_EVERY = 80; // [ms] between two pictures of the side panel while the robots drive

class App {
  constructor(about, replays) {
    Object.assign(this, { replays, colours: about.colours, terms: about.terms, layers: { ...about.layers } });
    Object.assign(this, { frame: 0, active: 0, robot: -1, following: false, chartSeconds: 60, changed: true });
    this.view = new View();
    this.still = matchMedia("(prefers-reduced-motion: reduce)").matches;
    this.canvases = [...document.querySelectorAll(".floor canvas")];
  }

  change(what) {
    Object.assign(this, what);
    this.changed = true;
  }

  choose(robot, active = this.active) {
    const most = this.replays[active].robots;
    const chosen = robot < -1 ? most - 1 : robot >= most ? -1 : robot;
    this.change({ robot: chosen, active, following: this.following && chosen >= 0 });
    document.querySelector("#robot").classList.toggle("chosen", chosen >= 0);
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
    this.change({ dark, css });
    buildLegend(this);
  }

  // The charts of the chosen robot, or of all where none is chosen.
  chartsShown() {
    return chartsOf(this);
  }

  // The part of time that the charts show [s]; of all robots together the whole of it.
  span() {
    const all = this.last * this.seconds;
    if (this.robot < 0 || !this.chartSeconds || this.chartSeconds >= all) return { from: 0, to: Math.max(all, this.seconds) };
    const now = this.frame * this.seconds;
    return { from: now - this.chartSeconds / 2, to: now + this.chartSeconds / 2 };
  }

  // Draw the floors as they are now.
  drawFloors() {
    for (const episode of this.replays) episode.goTo((this.frame * this.seconds) / episode.seconds);
    if (this.following) [this.view.x, this.view.y] = this.replays[this.active].centre(this.robot);
    this.canvases.forEach((canvas, k) => drawStage(canvas, this.replays[k], this));
  }
}

// Go on with each picture of the browser, and draw what has changed.
function run(app) {
  let before = performance.now(), panelAt = 0;
  const tick = (now) => {
    app.advance(Math.min(now - before, 100) / 1000);
    before = now;
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
