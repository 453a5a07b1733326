// The last minutes of a world that goes on: an episode of so many moments, in which the oldest make room for new ones.

const KEPT_NUMBERS = 400000; // robots times moments
const KEPT_MOMENTS = [600, 3000]; // at least and at most
const BY_ROBOT = ["x", "y", "heading", "speed", "steer", "along", "goal", "route", "waits_for", "yields_to", "held_by", "flags"];
const BY_STOP = ["goal_x", "goal_y", "goal_heading"]; // where robots stop at goals
const BY_PERSON = ["person_x", "person_y", "person_heading"];

class Moments extends Episode {
  constructor(message, flags) {
    const frames = Math.min(Math.max(Math.floor(KEPT_NUMBERS / message.robots), KEPT_MOMENTS[0]), KEPT_MOMENTS[1]);
    super({ ...message, frames }, { ...message.columns }, flags); // for columns of its own come into their place
    const rows = { totals: 3 };
    for (const name of [...BY_ROBOT, ...BY_STOP]) if (message.columns[name]) rows[name] = this.robots;
    for (const name of BY_PERSON) rows[name] = this.people;
    this.kept = Object.entries(rows).map(([name, count]) => ({ name, count, values: new Float32Array(count * frames) }));
    for (const { name, values } of this.kept) this.columns[name] = { values, unit: 1 };
    Object.assign(this, { last: -1, events: [], waiting: new Uint32Array(frames), samples: [] });
    this.add(message.columns, message);
  }

  readRoutes() {
    return {}; // by number
  }

  // Add the moments of a message; returns how many old ones had to go.
  add(columns, message) {
    this.samples = [...this.samples, ...message.samples].slice(-KEPT_SAMPLES);
    const gone = this.last + 1 + message.count > this.frames ? this.forget(Math.ceil(this.frames / 4)) : 0;
    routesOf(columns).forEach((points, k) => (this.routes[message.routes[k]] = points));
    for (const { name, count, values } of this.kept) {
      const { values: added, unit } = columns[name];
      for (let i = 0; i < count; i++) {
        for (let k = 0; k < message.count; k++) {
          values[i * this.frames + this.last + 1 + k] = added[i * message.count + k] * unit;
        }
      }
    }
    for (let k = 0; k < message.count; k++) this.look(++this.last);
    this.next = message.first + message.count;
    return gone;
  }

  // What is worked out of each moment once.
  look(k) {
    let waiting = 0;
    for (let i = 0; i < this.robots; i++) if (this.get("waits_for", i, k) >= 0) waiting++;
    this.waiting[k] = waiting;
    this.events.push(...contactsAt(this, k));
    if (this.gapsFor >= 0) this.gaps[k] = gapAt(this, this.gapsFor, k);
  }

  forget(count) {
    const { frames } = this;
    for (const { count: rows, values } of this.kept) {
      for (let row = 0; row < rows; row++) values.copyWithin(row * frames, row * frames + count, (row + 1) * frames);
    }
    this.waiting.copyWithin(0, count);
    this.gaps?.copyWithin(0, count);
    this.last -= count;
    this.begin += count * this.seconds;
    this.events = this.events.filter((event) => event.frame >= count);
    for (const event of this.events) [event.frame, event.end] = [event.frame - count, event.end - count];
    const used = new Set();
    for (let i = 0; i < this.robots; i++) {
      for (let k = 0; k <= this.last; k++) used.add(this.get("route", i, k));
    }
    for (const number of Object.keys(this.routes)) if (!used.has(Number(number))) delete this.routes[number];
    return count;
  }
}
