// The still part: floor, heights, stations, picks, one-way aisles and shelves. Painted once, then shown as a picture.

const LARGEST_PICTURE = 4096; // [px] a side, beyond which the part in view is painted each time
const BOX_SIDES = [[0.43, 0.08], [0.3, 0.05]]; // half sides and corners of a box and its lid [cells]

// Draw ground and floor from a picture of just this view, made anew where the view is another.
// place: { scale [px/m], left, top: where the floor's north-west corner is [px] }.
function drawFloor(context, episode, place, inks) {
  const { canvas } = context;
  const key = [canvas.width, canvas.height, place.scale, place.left, place.top, inks.name].join();
  if (canvas.stillKey !== key) {
    canvas.still ??= document.createElement("canvas");
    if (canvas.still.width !== canvas.width || canvas.still.height !== canvas.height) {
      Object.assign(canvas.still, { width: canvas.width, height: canvas.height });
    }
    const still = canvas.still.getContext("2d", { alpha: false });
    still.fillStyle = inks.ground;
    still.fillRect(0, 0, canvas.width, canvas.height);
    drawScaledFloor(still, episode, place, inks);
    canvas.stillKey = key;
  }
  context.drawImage(canvas.still, 0, 0);
}

function drawScaledFloor(context, episode, place, inks) {
  const side = Math.max(episode.width, episode.height);
  const bucket = 2 ** (Math.ceil(2 * Math.log2(place.scale)) / 2);
  if (bucket * side > LARGEST_PICTURE) {
    paintFloor(context, episode, place, inks, cellsInView(context.canvas, episode, place));
    return;
  }
  const picture = floorPicture(episode, bucket, inks);
  const ratio = place.scale / bucket;
  context.imageSmoothingQuality = "medium";
  context.drawImage(picture, place.left, place.top, picture.width * ratio, picture.height * ratio);
}

function floorPicture(episode, scale, inks) {
  const key = `${scale} ${inks.name}`;
  if (episode.pictureKey === key) return episode.picture;
  const picture = document.createElement("canvas");
  picture.width = Math.ceil(episode.width * scale);
  picture.height = Math.ceil(episode.height * scale);
  const all = { top: 0, left: 0, bottom: episode.gridRows - 1, right: episode.gridColumns - 1 };
  paintFloor(picture.getContext("2d"), episode, { scale, left: 0, top: 0 }, inks, all);
  Object.assign(episode, { picture, pictureKey: key });
  return picture;
}

function cellsInView(canvas, episode, place) {
  const cell = episode.cell * place.scale;
  const clip = (value, most) => Math.min(Math.max(Math.floor(value), 0), most);
  return {
    left: clip(-place.left / cell, episode.gridColumns - 1),
    right: clip((canvas.width - place.left) / cell, episode.gridColumns - 1),
    top: clip(-place.top / cell, episode.gridRows - 1),
    bottom: clip((canvas.height - place.top) / cell, episode.gridRows - 1),
  };
}

function paintFloor(context, episode, place, inks, part) {
  const cell = episode.cell * place.scale;
  context.fillStyle = inks.floor;
  context.fillRect(place.left, place.top, episode.width * place.scale, episode.height * place.scale);
  paintHeights(context, episode, place, inks);
  if (cell >= 7) paintSeams(context, place, inks, part, cell);
  const marks = episode.columns.cells.values;
  forCells(episode, part, (row, column, at) => {
    const x = place.left + column * cell, y = place.top + row * cell;
    if (marks[at] & 4) paintStation(context, x, y, cell, inks);
    else if (marks[at] & 2 && cell >= 7) paintPick(context, x, y, cell, inks);
    const way = episode.columns.one_way.values[at];
    if (way) paintArrow(context, x, y, cell, way, inks);
  });
  paintShelves(context, episode, place, inks, part, cell);
  paintDiscs(context, episode, place, inks);
}

function forCells(episode, part, each) {
  for (let row = part.top; row <= part.bottom; row++) {
    for (let column = part.left; column <= part.right; column++) {
      each(row, column, row * episode.gridColumns + column);
    }
  }
}

// Raised floor is warm, sunken floor cool; blurred between cells by the browser's own scaling.
function paintHeights(context, episode, place, inks) {
  const { values } = episode.columns.height;
  let most = 0;
  for (const value of values) most = Math.max(most, Math.abs(value));
  if (!most) return;
  const small = document.createElement("canvas");
  small.width = episode.gridColumns;
  small.height = episode.gridRows;
  const image = new ImageData(small.width, small.height);
  values.forEach((value, k) => {
    image.data.set([...(value > 0 ? inks.raised : inks.sunken), (150 * Math.abs(value)) / most], 4 * k);
  });
  small.getContext("2d").putImageData(image, 0, 0);
  context.imageSmoothingEnabled = true;
  context.drawImage(small, place.left, place.top, episode.width * place.scale, episode.height * place.scale);
}

function paintSeams(context, place, inks, part, cell) {
  context.strokeStyle = inks.seam;
  context.lineWidth = 1;
  context.beginPath();
  const low = place.top + part.top * cell, high = place.top + (part.bottom + 1) * cell;
  const from = place.left + part.left * cell, to = place.left + (part.right + 1) * cell;
  for (let column = part.left; column <= part.right + 1; column++) {
    const x = Math.round(place.left + column * cell) + 0.5;
    context.moveTo(x, low);
    context.lineTo(x, high);
  }
  for (let row = part.top; row <= part.bottom + 1; row++) {
    const y = Math.round(place.top + row * cell) + 0.5;
    context.moveTo(from, y);
    context.lineTo(to, y);
  }
  context.stroke();
}

function paintStation(context, x, y, cell, inks) {
  context.beginPath();
  context.roundRect(x + 0.07 * cell, y + 0.07 * cell, 0.86 * cell, 0.86 * cell, 0.14 * cell);
  context.fillStyle = inks.station;
  context.fill();
  context.strokeStyle = inks.stationEdge;
  context.lineWidth = Math.max(0.8, 0.05 * cell);
  context.stroke();
}

function paintPick(context, x, y, cell, inks) {
  context.fillStyle = inks.pick;
  context.beginPath();
  context.arc(x + cell / 2, y + cell / 2, 0.085 * cell, 0, TURN);
  context.fill();
}

// way: 1 east, 2 north, 3 west, 4 south.
function paintArrow(context, x, y, cell, way, inks) {
  const angle = (-(way - 1) * Math.PI) / 2;
  context.save();
  context.translate(x + cell / 2, y + cell / 2);
  context.rotate(angle);
  context.strokeStyle = inks.oneWay;
  context.lineWidth = Math.max(1, 0.09 * cell);
  context.lineCap = context.lineJoin = "round";
  context.beginPath();
  context.moveTo(-0.12 * cell, -0.22 * cell);
  context.lineTo(0.12 * cell, 0);
  context.lineTo(-0.12 * cell, 0.22 * cell);
  context.stroke();
  context.restore();
}

function paintShelves(context, episode, place, inks, part, cell) {
  const marks = episode.columns.cells.values;
  const shelves = [];
  forCells(episode, part, (row, column, at) => {
    if (marks[at] & 1) shelves.push([place.left + column * cell, place.top + row * cell, row, column]);
  });
  context.fillStyle = inks.shade;
  for (const [x, y] of shelves) context.fillRect(x + 0.14 * cell, y + 0.2 * cell, cell, cell);
  context.fillStyle = inks.rack;
  for (const [x, y] of shelves) context.fillRect(x - 0.3, y - 0.3, cell + 0.6, cell + 0.6);
  if (cell < 5) return;
  for (const [x, y, row, column] of shelves) {
    const tone = inks.boxes[scattered(row, column) % inks.boxes.length];
    for (const [k, [half, corner]] of BOX_SIDES.entries()) {
      context.fillStyle = k ? inks.lid : tone;
      context.beginPath();
      context.roundRect(x + (0.5 - half) * cell, y + (0.5 - half) * cell, 2 * half * cell, 2 * half * cell, corner * cell);
      context.fill();
    }
  }
}

function paintDiscs(context, episode, place, inks) {
  for (const [moved, less, ink] of [[1, 0, inks.shade], [0, 0, inks.rack], [0, 0.06, inks.boxes[0]]]) {
    context.fillStyle = ink;
    for (const [x, y, radius] of episode.discs) {
      const across = place.left + (x + 0.14 * moved) * place.scale;
      const down = place.top + (episode.height - y + 0.2 * moved) * place.scale;
      context.beginPath();
      context.arc(across, down, Math.max(radius - less, radius / 2) * place.scale, 0, TURN);
      context.fill();
    }
  }
}

// A whole number for each cell, without a visible pattern.
function scattered(row, column) {
  const mixed = (Math.imul(row, 73856093) ^ Math.imul(column, 19349663)) >>> 0;
  return (Math.imul(mixed ^ (mixed >>> 7), 2654435761) >>> 0) >>> 16;
}
