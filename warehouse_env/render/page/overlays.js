// Overlays on the floor: routes, trails, goals, lidar, waiting, and recent events.

const TRAIL_SECONDS = 12;
const OWN_TRAIL_SECONDS = 60; // of the chosen robot
const FLASH_SECONDS = 2;

function lineTo(context, place, x, y, first) {
  const px = place.left + x * place.scale, py = place.bottom - y * place.scale;
  if (first) context.moveTo(px, py);
  else context.lineTo(px, py);
}

function drawTrails(context, episode, place, style) {
  context.lineJoin = context.lineCap = "round";
  for (let i = 0; i < episode.robots; i++) {
    const own = i === style.robot;
    const steps = Math.round((own ? OWN_TRAIL_SECONDS : TRAIL_SECONDS) / episode.seconds);
    context.beginPath();
    for (let k = Math.max(0, episode.moment - steps); k <= episode.moment; k++) {
      lineTo(context, place, episode.get("x", i, k), episode.get("y", i, k), k === Math.max(0, episode.moment - steps));
    }
    lineTo(context, place, episode.now[5 * i], episode.now[5 * i + 1]);
    context.strokeStyle = style.colours[i];
    context.globalAlpha = own ? 0.75 : 0.28;
    context.lineWidth = Math.max(style.ratio, (own ? 0.16 : 0.22) * place.scale);
    context.stroke();
  }
  context.globalAlpha = 1;
}

function drawRoutes(context, episode, place, style) {
  context.lineJoin = "round";
  context.lineCap = "butt";
  for (let i = 0; i < episode.robots; i++) {
    if (!episode.flag("alive", i, episode.moment)) continue;
    const own = i === style.robot;
    context.strokeStyle = style.colours[i];
    context.globalAlpha = own ? 1 : style.robot >= 0 ? 0.28 : 0.5;
    context.lineWidth = Math.max((own ? 2 : 1) * style.ratio, (own ? 0.1 : 0.04) * place.scale);
    traceRoute(context, episode, i, place);
    context.stroke();
  }
  context.globalAlpha = 1;
}

// The part of its route that a robot still has ahead.
function traceRoute(context, episode, robot, place) {
  const points = episode.routes[episode.get("route", robot, episode.moment)];
  const driven = episode.get("along", robot, episode.moment);
  context.beginPath();
  let first = true;
  for (let k = 3; k < points.length; k += 3) {
    if (points[k + 2] < driven) continue;
    if (first) {
      const part = Math.max(0, (driven - points[k - 1]) / Math.max(points[k + 2] - points[k - 1], 1e-6));
      const x = points[k - 3] + part * (points[k] - points[k - 3]);
      lineTo(context, place, x, points[k - 2] + part * (points[k + 1] - points[k - 2]), true);
      first = false;
    }
    lineTo(context, place, points[k], points[k + 1]);
  }
}

function drawGoals(context, episode, place, style) {
  for (let i = 0; i < episode.robots; i++) {
    if (!episode.flag("alive", i, episode.moment)) continue;
    const [x, y] = episode.goalAt(i, episode.moment);
    const px = place.left + x * place.scale, py = place.bottom - y * place.scale;
    const size = Math.max(2.5 * style.ratio, 0.3 * episode.cell * place.scale);
    context.globalAlpha = style.robot >= 0 && style.robot !== i ? 0.55 : 1;
    const heading = episode.goalHeading(i, episode.moment);
    if (heading !== null) {
      nose(context, px, py, heading, 1.9 * size, style.inks.nose);
      nose(context, px, py, heading, 1.7 * size, style.colours[i]);
    }
    disc(context, px, py, size, style.inks.nose);
    disc(context, px, py, 0.85 * size, style.colours[i]);
    disc(context, px, py, 0.6 * size, style.inks.nose);
    disc(context, px, py, 0.32 * size, style.colours[i]);
  }
  context.globalAlpha = 1;
}

// A triangle that points where a robot is to face.
function nose(context, x, y, heading, reach, ink) {
  const c = Math.cos(heading), s = -Math.sin(heading);
  context.beginPath();
  context.moveTo(x + reach * c, y + reach * s);
  for (const side of [0.4, -0.4]) context.lineTo(x + reach * (0.3 * c - side * s), y + reach * (0.3 * s + side * c));
  context.fillStyle = ink;
  context.fill();
}

function disc(context, x, y, radius, ink) {
  context.beginPath();
  context.arc(x, y, radius, 0, TURN);
  context.fillStyle = ink;
  context.fill();
}

function drawLidar(context, episode, place, style) {
  const [x, y] = episode.centre(style.robot);
  const heading = episode.now[5 * style.robot + 2];
  const distances = lidarOf(episode, style.robot);
  const ends = [...distances].map((distance, ray) => {
    const angle = heading + (TURN * ray) / distances.length;
    return [x + distance * Math.cos(angle), y + distance * Math.sin(angle), distance < episode.lidar.range - 1e-6];
  });
  context.beginPath();
  ends.forEach(([ex, ey], ray) => lineTo(context, place, ex, ey, ray === 0));
  context.closePath();
  context.fillStyle = style.inks.lidar;
  context.fill();
  context.beginPath();
  for (const [ex, ey] of ends) {
    lineTo(context, place, x, y, true);
    lineTo(context, place, ex, ey);
  }
  context.strokeStyle = style.inks.ray;
  context.lineWidth = style.ratio;
  context.stroke();
  for (const [ex, ey, met] of ends) {
    if (met) disc(context, place.left + ex * place.scale, place.bottom - ey * place.scale, 2.2 * style.ratio, style.inks.hit);
  }
}

// Arrows from a waiting robot to the one that it waits for; thin dotted ones from a robot that gives way while driving.
function drawWaiting(context, episode, place, style) {
  for (let i = 0; i < episode.robots; i++) {
    const waits = episode.get("waits_for", i, episode.moment);
    const yields = Math.max(episode.get("yields_to", i, episode.moment), episode.get("held_by", i, episode.moment));
    if (waits < 0 && yields < 0) continue;
    const stuck = episode.flag("deadlocked", i, episode.moment);
    const ink = stuck ? style.marks.deadlock : style.inks.arrow;
    const wide = (waits < 0 ? 1 : stuck ? 3 : 2) * style.ratio;
    drawArrow(context, place, episode.centre(i), episode.centre(waits < 0 ? yields : waits), ink, wide, style, waits < 0);
  }
}

function drawArrow(context, place, from, to, ink, wide, style, dotted) {
  const begin = [place.left + from[0] * place.scale, place.bottom - from[1] * place.scale];
  const end = [place.left + to[0] * place.scale, place.bottom - to[1] * place.scale];
  const far = Math.hypot(end[0] - begin[0], end[1] - begin[1]) || 1;
  const ux = (end[0] - begin[0]) / far, uy = (end[1] - begin[1]) / far;
  const head = 3.2 * wide + 2 * style.ratio;
  // beside the middle, so that two who wait for each other show two arrows
  const aside = [-uy * 1.6 * wide, ux * 1.6 * wide];
  const at = (along, across) => [
    begin[0] + aside[0] + along * ux - across * uy, begin[1] + aside[1] + along * uy + across * ux,
  ];
  const draw = (grow, colour) => {
    context.strokeStyle = context.fillStyle = colour;
    context.lineWidth = wide + 2 * grow;
    context.setLineDash(dotted ? [2 * style.ratio, 3 * style.ratio] : []);
    context.beginPath();
    context.moveTo(...at(0, 0));
    context.lineTo(...at(far - head, 0));
    context.stroke();
    context.setLineDash([]);
    context.beginPath();
    for (const corner of [at(far + grow, 0), at(far - head - grow, 0.62 * head + grow), at(far - head - grow, -0.62 * head - grow)]) {
      context.lineTo(...corner);
    }
    context.fill();
  };
  context.lineCap = "butt";
  if (!dotted) draw(1.2 * style.ratio, style.inks.halo);
  draw(0, ink);
}

// Rings that open around what has just happened, each kind with a sign of its own; around circles as long as they last.
function drawEvents(context, episode, place, style) {
  const flash = FLASH_SECONDS / episode.seconds;
  const now = episode.moment + episode.part;
  for (const event of episode.events) {
    if (event.frame > now) break;
    if (event.end + flash < now) continue;
    const age = style.still ? 0.5 : ((now - event.frame) / flash) % 1;
    const x = place.left + event.x * place.scale, y = place.bottom - event.y * place.scale;
    const size = Math.max(11 * style.ratio, 0.75 * place.scale);
    context.globalAlpha = 1 - age;
    context.strokeStyle = style.marks[event.kind];
    context.lineWidth = 3 * style.ratio;
    context.beginPath();
    context.arc(x, y, size * (0.8 + 1.1 * age), 0, TURN);
    context.stroke();
    context.globalAlpha = 1;
    drawSign(context, event.kind, x, y - size - 8 * style.ratio, 8 * style.ratio, style);
  }
}

// Collision: a cross on a disc; near miss: a triangle; deadlock: a ring on a square. The same in legend and time line.
function drawSign(context, kind, x, y, size, style) {
  context.fillStyle = style.marks[kind];
  context.strokeStyle = style.inks.sign;
  context.lineWidth = 0.22 * size;
  context.lineJoin = context.lineCap = "round";
  context.beginPath();
  if (kind === "collision") context.arc(x, y, size, 0, TURN);
  else if (kind === "near") {
    for (const angle of [-0.25, 1 / 12, 5 / 12]) {
      context.lineTo(x + 1.15 * size * Math.cos(TURN * angle), y + 0.15 * size + 1.15 * size * Math.sin(TURN * angle));
    }
    context.closePath();
  } else context.roundRect(x - 0.9 * size, y - 0.9 * size, 1.8 * size, 1.8 * size, 0.35 * size);
  context.fill();
  context.beginPath();
  if (kind === "collision") {
    context.moveTo(x - 0.4 * size, y - 0.4 * size);
    context.lineTo(x + 0.4 * size, y + 0.4 * size);
    context.moveTo(x + 0.4 * size, y - 0.4 * size);
    context.lineTo(x - 0.4 * size, y + 0.4 * size);
  } else if (kind === "deadlock") context.arc(x, y, 0.45 * size, 0.6, TURN - 0.3);
  else {
    context.moveTo(x, y - 0.35 * size);
    context.lineTo(x, y + 0.15 * size);
    context.moveTo(x, y + 0.48 * size);
    context.lineTo(x, y + 0.5 * size);
  }
  context.stroke();
}

function drawChosen(context, episode, place, style) {
  const [x, y] = episode.centre(style.robot);
  context.beginPath();
  context.arc(
    place.left + x * place.scale, place.bottom - y * place.scale,
    Math.max(12 * style.ratio, 0.62 * episode.bodyOf(style.robot).length * place.scale + 4 * style.ratio), 0, TURN,
  );
  for (const [wide, ink] of [[4.5, style.inks.halo], [2, style.inks.chosen]]) {
    context.lineWidth = wide * style.ratio;
    context.strokeStyle = ink;
    context.stroke();
  }
}
