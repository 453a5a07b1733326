// Robots as they are: true rectangles about the front axle, steered wheels, load, nose, number.

const WHEELS_FROM = 14; // [CSS px/m] from which wheels are drawn
const NUMBERS_FROM = 26; // and numbers

// Outlines of a body in its own frame [m]: x ahead of the fixed axle, y to the left.
function shapesOf(body) {
  const rear = body.front - body.length, half = body.width / 2;
  const box = (inset, corner) => {
    const path = new Path2D();
    const place = [rear + inset, inset - half, body.length - 2 * inset, 2 * (half - inset)];
    if (corner) path.roundRect(...place, corner);
    else path.rect(...place);
    return path;
  };
  const nose = new Path2D();
  nose.moveTo(body.front - 0.05, 0);
  nose.lineTo(body.front - 0.24, half - 0.16);
  nose.lineTo(body.front - 0.24, 0.16 - half);
  nose.closePath();
  const wheel = new Path2D();
  wheel.roundRect(-0.12, -0.05, 0.24, 0.1, 0.03);
  const plate = new Path2D();
  plate.roundRect(rear + 0.1, 0.19 - half, body.length - 0.42, body.width - 0.38, 0.04);
  return { hull: box(0, 0.12), skin: box(0.035, 0.09), halo: box(-0.14, 0.22), small: box(0, 0), plate, nose, wheel };
}

// Where a body's own frame lies on a canvas: place as for drawFloor, bottom: the floor's south edge [px].
function intoBody(context, place, x, y, heading) {
  const cos = place.scale * Math.cos(heading), sin = place.scale * Math.sin(heading);
  context.setTransform(cos, -sin, -sin, -cos, place.left + x * place.scale, place.bottom - y * place.scale);
}

function drawRobots(context, episode, place, style) {
  for (let pass = 0; pass < 2; pass++) {
    for (let i = 0; i < episode.robots; i++) {
      // parked ones first, so that what drives lies on top
      if (episode.flag("alive", i, episode.moment) === (pass === 1)) drawRobot(context, episode, i, place, style);
    }
  }
  context.setTransform(1, 0, 0, 1, 0, 0);
}

function drawRobot(context, episode, robot, place, style) {
  const at = 5 * robot, k = episode.moment;
  const [x, y, heading, , steer] = episode.now.subarray(at, at + 5);
  const px = place.left + x * place.scale, py = place.bottom - y * place.scale;
  const body = episode.bodyOf(robot), shapes = episode.shapes[episode.kinds[robot]];
  const margin = 2 * body.length * place.scale;
  if (px < -margin || py < -margin || px > context.canvas.width + margin || py > context.canvas.height + margin) return;
  const alive = episode.flag("alive", robot, k);
  const colour = alive ? style.colours[robot] : style.inks.parked;
  const fill = (shape, ink) => {
    context.fillStyle = ink;
    context.fill(shape);
  };
  intoBody(context, place, x, y, heading);
  const rim = rimOf(episode, robot, k, style);
  if (rim) fill(shapes.halo, rim);
  if (place.scale >= WHEELS_FROM * style.ratio) {
    fill(shapes.hull, style.edges[robot]);
    fill(shapes.skin, colour);
    drawWheels(context, body, shapes, steer, style);
  } else fill(shapes.small, colour);
  if (episode.flag("loaded", robot, k) && alive) drawLoad(context, body, shapes, style);
  fill(shapes.nose, style.inks.nose);
  if (style.numbers && place.scale >= NUMBERS_FROM * style.ratio) drawNumber(context, episode, robot, place, style);
}

// What a robot stands out in: in touch, in a wait cycle, waiting.
function rimOf(episode, robot, frame, style) {
  if (episode.flag("touching", robot, frame)) return style.marks.collision;
  if (!style.waiting) return null;
  if (episode.flag("deadlocked", robot, frame)) return style.marks.deadlock;
  return episode.get("waits_for", robot, frame) >= 0 ? style.marks.waiting : null;
}

function drawWheels(context, body, shapes, steer, style) {
  const ahead = body.front > body.length / 2;
  const axle = ahead ? body.wheelbase : -body.wheelbase;
  const side = body.width / 2 - 0.1;
  context.fillStyle = style.inks.wheel;
  for (const left of [side, -side]) {
    context.save();
    context.translate(0, left);
    context.fill(shapes.wheel);
    context.translate(axle, 0);
    context.rotate(ahead ? -steer : steer);
    context.fill(shapes.wheel);
    context.restore();
  }
}

function drawLoad(context, body, shapes, style) {
  const rear = body.front - body.length;
  context.fillStyle = style.inks.load;
  context.fill(shapes.plate);
  context.fillStyle = style.inks.strap;
  const middle = (rear + body.front - 0.22) / 2;
  context.fillRect(middle - 0.03, 0.19 - body.width / 2, 0.06, body.width - 0.38);
}

function drawNumber(context, episode, robot, place, style) {
  const [x, y] = episode.centre(robot);
  context.setTransform(1, 0, 0, 1, 0, 0);
  context.font = `600 ${Math.round(0.25 * place.scale)}px ${style.font}`;
  context.textAlign = "center";
  context.textBaseline = "middle";
  context.fillStyle = style.inks.number;
  const heading = episode.now[5 * robot + 2];
  const px = place.left + (x - 0.1 * Math.cos(heading)) * place.scale;
  const py = place.bottom - (y - 0.1 * Math.sin(heading)) * place.scale;
  context.strokeStyle = style.inks.nose;
  context.lineWidth = 0.06 * place.scale;
  context.lineJoin = "round";
  context.strokeText(robot, px, py);
  context.fillText(robot, px, py);
}
