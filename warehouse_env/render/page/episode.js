// One world of N robots at F moments: its columns, and where everybody is between two moments.

const TURN = 2 * Math.PI;

function wrapped(angle) {
  return angle - TURN * Math.round(angle / TURN);
}

// The routes in columns of all their points, one behind the other: x, y, metres from the start of each point.
function routesOf(columns) {
  const { route_points: counts, route_x: x, route_y: y } = columns;
  const routes = [];
  let start = 0;
  for (const count of counts.values) {
    const points = new Float32Array(3 * count);
    for (let k = 0; k < count; k++) {
      points[3 * k] = x.values[start + k] * x.unit;
      points[3 * k + 1] = y.values[start + k] * y.unit;
      const far = k ? Math.hypot(points[3 * k] - points[3 * k - 3], points[3 * k + 1] - points[3 * k - 2]) : 0;
      points[3 * k + 2] = k ? points[3 * k - 1] + far : 0;
    }
    routes.push(points);
    start += count;
  }
  return routes;
}

class Episode {
  constructor(about, columns, flags) {
    Object.assign(this, about);
    this.columns = columns;
    this.bit = Object.fromEntries(flags.map((name, k) => [name, 1 << k]));
    this.width = this.gridColumns * this.cell;
    this.height = this.gridRows * this.cell;
    this.last = this.frames - 1;
    this.routes = this.readRoutes();
    // of the moment shown: x, y, heading, speed, steer of each robot
    this.now = new Float64Array(this.robots * 5);
    this.walking = new Float64Array(this.people * 3); // x, y, heading of each person
    this.moment = 0; // whole number of the last moment before
  }

  get(name, robot, frame) {
    const column = this.columns[name];
    return column.values[robot * this.frames + frame] * column.unit;
  }

  flag(name, robot, frame) {
    return (this.columns.flags.values[robot * this.frames + frame] & this.bit[name]) !== 0;
  }

  total(k, frame) {
    return this.columns.totals.values[k * this.frames + frame];
  }

  readRoutes() {
    return routesOf(this.columns);
  }

  // Fill `now`; frame may lie between two moments.
  goTo(frame) {
    const shown = Math.max(Math.min(frame + 1e-6, this.last), 0); // a live page may ask for what was before its first
    const k = Math.min(Math.floor(shown), this.last);
    const next = Math.min(k + 1, this.last);
    const part = shown - k;
    this.moment = k;
    this.part = part;
    this.fill(this.now, this.robots, ["x", "y", "heading", "speed", "steer"], k, next, part);
    for (let i = 0; i < this.robots; i++) {
      if (this.flag("alive", i, k)) this.bend(i, k, next, part);
      else this.now.set(["x", "y", "heading"].map((name) => this.get(name, i, k)), 5 * i); // nobody knows how it moves
    }
    this.fill(this.walking, this.people, ["person_x", "person_y", "person_heading"], k, next, part);
  }

  // Write columns, of which the third is an angle, at `part` of the way between two moments.
  fill(now, count, names, k, next, part) {
    for (let i = 0; i < count; i++) {
      const at = names.length * i;
      for (const [n, name] of names.entries()) {
        const a = this.get(name, i, k);
        const change = this.get(name, i, next) - a;
        now[at + n] = a + part * (n === 2 ? wrapped(change) : change);
      }
    }
  }

  // Lead a robot's front axle along a cubic (Hermite's) between two moments: it moves the way that it is headed, as
  // fast as it is, and the chord between moments 0.4 s apart would cut its bends by centimetres.
  bend(robot, k, next, part) {
    const x = this.get("x", robot, k), y = this.get("y", robot, k);
    const after = part * part * (3 - 2 * part), off = part * (1 - part) * this.seconds;
    const begin = this.get("heading", robot, k), leaving = off * (1 - part) * this.get("speed", robot, k);
    const end = this.get("heading", robot, next), coming = off * part * this.get("speed", robot, next);
    const along = (from, to, trig) => from + after * (to - from) + leaving * trig(begin) - coming * trig(end);
    this.now[5 * robot] = along(x, this.get("x", robot, next), Math.cos);
    this.now[5 * robot + 1] = along(y, this.get("y", robot, next), Math.sin);
  }

  bodyOf(robot) {
    return this.bodies[this.kinds[robot]];
  }

  // Metres from the front axle back to the middle of a robot's body.
  backOf(robot) {
    const body = this.bodyOf(robot);
    return body.length / 2 - body.front;
  }

  centre(robot) {
    const at = 5 * robot, back = this.backOf(robot);
    const heading = this.now[at + 2];
    return [this.now[at] - back * Math.cos(heading), this.now[at + 1] - back * Math.sin(heading)];
  }

  centreAt(robot, frame) {
    const heading = this.get("heading", robot, frame), back = this.backOf(robot);
    return [
      this.get("x", robot, frame) - back * Math.cos(heading),
      this.get("y", robot, frame) - back * Math.sin(heading),
    ];
  }

  goalAt(robot, frame) {
    if (this.columns.goal_x) return [this.get("goal_x", robot, frame), this.get("goal_y", robot, frame)];
    const cell = this.columns.goal.values[robot * this.frames + frame];
    const row = Math.floor(cell / this.gridColumns);
    const column = cell - row * this.gridColumns;
    return [(column + 0.5) * this.cell, (this.gridRows - row - 0.5) * this.cell];
  }

  // Which way a robot is to face at its goal, null where any will do.
  goalHeading(robot, frame) {
    const heading = this.columns.goal_heading ? this.get("goal_heading", robot, frame) : -1;
    return heading < 0 ? null : heading;
  }
}
