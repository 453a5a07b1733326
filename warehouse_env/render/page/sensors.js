// What a robot measures, worked out from where all are: its lidar, and the gap to the next robot.

// Metres from the middle of a robot's body to what each ray meets, at most the range.
function lidarOf(episode, robot) {
  const [x, y] = episode.centre(robot);
  const heading = episode.now[5 * robot + 2];
  const near = bodiesWithin(episode, robot, x, y, episode.lidar.range);
  const distances = new Float64Array(episode.lidar.rays);
  for (let ray = 0; ray < distances.length; ray++) {
    const angle = heading + (TURN * ray) / distances.length;
    const ux = Math.cos(angle), uy = Math.sin(angle);
    let distance = rayToShelf(episode, x, y, ux, uy);
    for (const disc of episode.discs) distance = Math.min(distance, rayToDisc(x, y, ux, uy, ...disc));
    for (let i = 0; i < episode.people; i++) distance = Math.min(distance, rayToPerson(episode, x, y, ux, uy, i));
    for (const body of near) distance = Math.min(distance, rayToBody(x, y, ux, uy, body));
    distances[ray] = distance;
  }
  return distances;
}

// The bodies that reach within `range` of a point.
function bodiesWithin(episode, robot, x, y, range) {
  const found = [];
  for (let j = 0; j < episode.robots; j++) {
    if (j === robot) continue;
    const [ox, oy] = episode.centre(j), { length, width } = episode.bodyOf(j);
    if (Math.hypot(ox - x, oy - y) > range + length + width) continue;
    const heading = episode.now[5 * j + 2];
    found.push({ x: ox, y: oy, cos: Math.cos(heading), sin: Math.sin(heading), length, width });
  }
  return found;
}

// From cell to cell along the ray (Amanatides and Woo 1987); outside the floor all is solid.
function rayToShelf(episode, x, y, ux, uy) {
  const size = episode.cell;
  let column = Math.floor(x / size), up = Math.floor(y / size);
  const stepX = ux > 0 ? 1 : -1, stepY = uy > 0 ? 1 : -1;
  const perX = Math.abs(size / ux), perY = Math.abs(size / uy);
  let nextX = ((ux > 0 ? column + 1 : column) * size - x) / ux;
  let nextY = ((uy > 0 ? up + 1 : up) * size - y) / uy;
  for (;;) {
    const distance = Math.min(nextX, nextY);
    if (!(distance < episode.lidar.range)) return episode.lidar.range;
    if (nextX < nextY) [column, nextX] = [column + stepX, nextX + perX];
    else [up, nextY] = [up + stepY, nextY + perY];
    if (isSolid(episode, column, up)) return distance;
  }
}

function isSolid(episode, column, up) {
  const row = episode.gridRows - 1 - up;
  const outside = column < 0 || row < 0 || column >= episode.gridColumns || row >= episode.gridRows;
  return outside || (episode.columns.cells.values[row * episode.gridColumns + column] & 1) === 1;
}

function rayToBody(x, y, ux, uy, body) {
  const dx = x - body.x, dy = y - body.y;
  const along = slab(dx * body.cos + dy * body.sin, ux * body.cos + uy * body.sin, body.length / 2);
  const across = slab(dy * body.cos - dx * body.sin, uy * body.cos - ux * body.sin, body.width / 2);
  const enter = Math.max(along[0], across[0]), leave = Math.min(along[1], across[1]);
  return enter <= leave && enter >= 0 ? enter : Infinity;
}

function rayToPerson(episode, x, y, ux, uy, person) {
  return rayToDisc(x, y, ux, uy, episode.walking[3 * person], episode.walking[3 * person + 1], episode.personRadius);
}

function rayToDisc(x, y, ux, uy, discX, discY, radius) {
  const dx = discX - x, dy = discY - y;
  const along = dx * ux + dy * uy;
  const inside = along * along - dx * dx - dy * dy + radius ** 2;
  return along > 0 && inside >= 0 ? Math.max(along - Math.sqrt(inside), 0) : Infinity;
}

function slab(from, per, half) {
  const a = (-half - from) / per, b = (half - from) / per;
  return a < b ? [a, b] : [b, a];
}

// Metres between a robot's body and the nearest other one's, at every moment; kept for the robot asked about last.
function gapsOf(episode, robot) {
  if (episode.gapsFor === robot) return episode.gaps;
  const gaps = new Float32Array(episode.frames);
  for (let k = 0; k <= episode.last; k++) gaps[k] = gapAt(episode, robot, k);
  episode.gapsFor = robot;
  episode.gaps = gaps;
  return gaps;
}

function gapAt(episode, robot, frame) {
  const own = bodyAt(episode, robot, frame);
  let least = Infinity;
  for (let j = 0; j < episode.robots; j++) {
    if (j === robot) continue;
    const other = bodyAt(episode, j, frame);
    if (Math.hypot(other.x - own.x, other.y - own.y) - own.reach - other.reach < least) {
      least = Math.min(least, cornerGap(own, other), cornerGap(other, own));
    }
  }
  return least;
}

function bodyAt(episode, robot, frame) {
  const heading = episode.get("heading", robot, frame);
  const cos = Math.cos(heading), sin = Math.sin(heading);
  const [x, y] = episode.centreAt(robot, frame), { length, width } = episode.bodyOf(robot);
  return { x, y, cos, sin, long: length / 2, wide: width / 2, reach: Math.hypot(length, width) / 2 };
}

// The least distance from a corner of one body to another body.
function cornerGap(one, other) {
  const { long: l, wide: w } = one;
  let least = Infinity;
  for (const [u, v] of [[l, w], [l, -w], [-l, w], [-l, -w]]) {
    const dx = one.x + u * one.cos - v * one.sin - other.x;
    const dy = one.y + u * one.sin + v * one.cos - other.y;
    const ahead = Math.max(Math.abs(dx * other.cos + dy * other.sin) - other.long, 0);
    const aside = Math.max(Math.abs(dy * other.cos - dx * other.sin) - other.wide, 0);
    least = Math.min(least, Math.hypot(ahead, aside));
  }
  return least;
}
