// What is shown of a world that goes on: always the newest, a moment late, so that robots glide from one to the next.

const BEHIND = 1.5; // moments
const BEHIND_SECONDS = 0.12; // and so many seconds of ours, for messages that come late
const LOST_AFTER = 8; // times as far behind, it is not caught up with but left out

class LiveApp extends App {
  constructor(about, message) {
    super(about, [new Moments(message, about.flags)]);
    dress(this.replays[0], about.colours.robots);
    Object.assign(this, { about, pace: {}, heardAt: [] });
  }

  get episode() {
    return this.replays[0];
  }

  get seconds() {
    return this.episode.seconds;
  }

  get last() {
    return this.episode.last;
  }

  get playing() {
    return this.pace.playing;
  }

  // Show another world. The chosen robot stays chosen if its number still exists.
  renew(message) {
    const before = this.episode;
    const moments = new Moments(message, this.about.flags);
    dress(moments, this.about.colours.robots);
    this.replays = [moments];
    this.heardAt = [];
    this.change({ frame: 0 });
    if (before.gridRows !== moments.gridRows || before.gridColumns !== moments.gridColumns) this.fit();
    for (const canvas of this.canvases) canvas.stillKey = null;
    this.choose(this.robot < moments.robots ? this.robot : -1);
    this.caption();
  }

  caption() {
    document.querySelector("figcaption b").textContent = this.episode.name;
    document.querySelector("figcaption span").textContent = this.episode.about;
  }

  // Add new moments. A page that falls too far behind has a gap, which the next whole world closes.
  hear(message) {
    if (message.first !== this.episode.next) return;
    this.frame -= this.episode.add(message.columns, message);
    const now = performance.now();
    this.heardAt.push([now, message.first + message.count]);
    while (this.heardAt.length > 2 && this.heardAt[0][0] < now - 1500) this.heardAt.shift();
    this.changed = true;
  }

  // Moments that come in a second of ours.
  get rate() {
    if (this.heardAt.length < 2) return 1 / this.seconds;
    const [[from, first], [to, last]] = [this.heardAt[0], this.heardAt[this.heardAt.length - 1]];
    return ((last - first) / Math.max(to - from, 1)) * 1000;
  }

  // Go on by so many seconds of ours: as fast as moments come, a little faster or slower to stay as far behind.
  advance(seconds) {
    if (this.frame >= this.last) return;
    const rate = this.rate, behind = Math.max(BEHIND, rate * BEHIND_SECONDS);
    const lag = this.last - this.frame;
    if (lag > LOST_AFTER * behind + rate) this.frame = this.last - behind;
    else if (!this.pace.playing) this.frame += Math.max(lag * Math.min(1, 10 * seconds), 0.5 * seconds);
    else this.frame += rate * seconds * Math.min(Math.max(1 + 0.5 * (lag / behind - 1), 0), 2);
    this.change({ frame: Math.min(this.frame, this.last) });
  }

  chartsShown() {
    return this.robot < 0 ? [] : super.chartsShown();
  }

  span() {
    const now = this.frame * this.seconds;
    return { from: this.chartSeconds ? now - this.chartSeconds : 0, to: Math.max(now, this.seconds) };
  }

  draw(all) {
    this.drawFloors();
    document.querySelector("#clock").textContent = clockOf(this.episode.begin + this.frame * this.seconds);
    if (!all) return;
    showLayers(this);
    showRobot(this);
    for (const chart of this.charts) Object.assign(chart, rangeOf(chart.lines.map((line) => Object.assign(line, { last: this.last }))));
    showCharts(this);
    showFleet(this);
  }
}

// Seconds as 0:07.3, 12:03.4.
function clockOf(seconds) {
  const tenths = Math.floor(seconds * 10 + 1e-6);
  const rest = (tenths % 600) / 10;
  return `${Math.floor(tenths / 600)}:${rest < 10 ? "0" : ""}${rest.toFixed(1)}`;
}
