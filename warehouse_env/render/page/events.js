// What happened when: contacts, near misses, circles of robots that wait for each other; and how many stand.

const DEADLOCK_SECONDS = 1; // that a circle lasts before it counts

function findEvents(episode) {
  const events = findDeadlocks(episode);
  for (let k = 1; k < episode.frames; k++) events.push(...contactsAt(episode, k));
  return events.sort((a, b) => a.frame - b.frame);
}

// Collisions and near misses of one moment.
function contactsAt(episode, k) {
  const events = [], hit = [], near = [];
  for (let i = 0; i < episode.robots; i++) {
    if (episode.flag("hit_shelf", i, k)) events.push(eventOf(episode, "collision", k, [i], "a shelf"));
    if (episode.flag("hit_person", i, k)) events.push(eventOf(episode, "collision", k, [i], "a person"));
    if (episode.flag("hit_robot", i, k)) hit.push(i);
    if (episode.flag("near_miss", i, k)) near.push(i);
  }
  for (const pair of pairsOf(episode, hit, k)) events.push(eventOf(episode, "collision", k, pair));
  for (const pair of pairsOf(episode, near, k)) events.push(eventOf(episode, "near", k, pair));
  return events;
}

function eventOf(episode, kind, frame, robots, what) {
  const centres = robots.map((robot) => episode.centreAt(robot, frame));
  const x = centres.reduce((sum, centre) => sum + centre[0], 0) / robots.length;
  const y = centres.reduce((sum, centre) => sum + centre[1], 0) / robots.length;
  return { kind, frame, end: frame, robots, x, y, what };
}

// Both robots of a pair are marked in the same step: each one's partner is the nearest of them.
function pairsOf(episode, marked, frame) {
  const pairs = new Map();
  for (const i of marked) {
    const [x, y] = episode.centreAt(i, frame);
    let best = -1, least = Infinity;
    for (const j of marked) {
      const [ox, oy] = episode.centreAt(j, frame);
      const far = Math.hypot(ox - x, oy - y);
      if (j !== i && far < least) [best, least] = [j, far];
    }
    const pair = best < 0 ? [i] : [Math.min(i, best), Math.max(i, best)];
    pairs.set(pair.join(), pair);
  }
  return [...pairs.values()];
}

// The circle that a robot waits in, lowest robot first.
function circleOf(episode, robot, frame) {
  const members = [];
  const waits = episode.columns.waits_for.values;
  for (let i = robot; i >= 0 && !members.includes(i); i = waits[i * episode.frames + frame]) members.push(i);
  return members.sort((a, b) => a - b);
}

function findDeadlocks(episode) {
  const open = new Map(), found = [];
  for (let k = 0; k < episode.frames; k++) {
    for (const [key, event] of open) if (event.end < k - 1) open.delete(key);
    for (let i = 0; i < episode.robots; i++) {
      if (!episode.flag("deadlocked", i, k)) continue;
      const members = circleOf(episode, i, k);
      if (members[0] !== i) continue;
      const key = members.join();
      if (!open.has(key)) {
        open.set(key, eventOf(episode, "deadlock", k, members));
        found.push(open.get(key));
      }
      open.get(key).end = k;
    }
  }
  return found.filter((event) => (event.end - event.frame) * episode.seconds >= DEADLOCK_SECONDS);
}

// How many robots wait at each moment.
function countWaiting(episode) {
  const counts = new Uint32Array(episode.frames);
  const waits = episode.columns.waits_for.values;
  for (let i = 0; i < episode.robots; i++) {
    for (let k = 0; k < episode.frames; k++) if (waits[i * episode.frames + k] >= 0) counts[k]++;
  }
  return counts;
}
