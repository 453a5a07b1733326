// The mouse as a hand: it looks, or sets and removes shelves or people.

const HANDS = ["look", "shelves", "people"];

function buildHand(app) {
  const bar = element("div");
  bar.id = "hand";
  bar.setAttribute("role", "group");
  bar.setAttribute("aria-label", "mouse tool");
  for (const hand of HANDS) {
    const button = element("button", "chip", hand);
    button.dataset.hand = hand;
    button.addEventListener("click", () => take(app, hand));
    bar.append(button);
  }
  const said = element("p");
  said.id = "said";
  said.setAttribute("role", "status");
  document.querySelector("#stage").append(bar, said);
  const [canvas] = app.canvases;
  // before the listeners that move the floor: an active tool does not move it
  const holder = canvas.parentElement;
  holder.addEventListener("pointerdown", (event) => begin(app, canvas, event), true);
  holder.addEventListener("pointermove", (event) => drag(app, canvas, event), true);
  holder.addEventListener("pointerup", (event) => end(app, canvas, event), true);
  holder.addEventListener("pointercancel", () => app.change({ stroke: null }), true);
  take(app, "look");
}

function take(app, hand) {
  app.change({ hand, stroke: null });
  document.querySelector("#stage").dataset.hand = hand;
  for (const button of document.querySelectorAll("#hand button")) {
    button.setAttribute("aria-pressed", button.dataset.hand === hand);
  }
}

// The cell under the pointer, as its row, column and number; null off the floor.
function cellAt(app, canvas, event) {
  const { episode, view } = app;
  const x = view.x + (event.offsetX - canvas.clientWidth / 2) / view.scale;
  const y = view.y - (event.offsetY - canvas.clientHeight / 2) / view.scale;
  const column = Math.floor(x / episode.cell), row = episode.gridRows - 1 - Math.floor(y / episode.cell);
  const inside = row >= 0 && column >= 0 && row < episode.gridRows && column < episode.gridColumns;
  return inside ? { row, column, x, y, shelf: (episode.columns.cells.values[row * episode.gridColumns + column] & 1) === 1 } : null;
}

function begin(app, canvas, event) {
  if (app.hand === "look" || event.target !== canvas || event.button !== 0) return;
  event.stopPropagation();
  canvas.setPointerCapture(event.pointerId);
  const cell = cellAt(app, canvas, event);
  if (cell) app.change({ stroke: { stand: !cell.shelf, cells: new Map(), last: cell } });
  drag(app, canvas, event);
}

function drag(app, canvas, event) {
  const { stroke } = app;
  if (!stroke) return;
  event.stopPropagation();
  const cell = cellAt(app, canvas, event);
  if (!cell) return;
  // all cells on the way, for the pointer may have leapt over some
  const far = Math.max(Math.abs(cell.row - stroke.last.row), Math.abs(cell.column - stroke.last.column), 1);
  for (let k = 0; k <= far; k++) {
    const row = Math.round(stroke.last.row + (k / far) * (cell.row - stroke.last.row));
    const column = Math.round(stroke.last.column + (k / far) * (cell.column - stroke.last.column));
    const shelf = (app.episode.columns.cells.values[row * app.episode.gridColumns + column] & 1) === 1;
    if (shelf !== stroke.stand) stroke.cells.set(`${row},${column}`, [row, column]);
  }
  stroke.last = cell;
  app.changed = true;
}

async function end(app, canvas, event) {
  const { stroke } = app;
  if (!stroke) return;
  event.stopPropagation();
  const cells = [...stroke.cells.values()];
  if (app.hand === "people") sendPerson(app, stroke.last);
  else if (cells.length) await send({ do: "shelves", cells, stand: stroke.stand });
  if (app.stroke === stroke) app.change({ stroke: null });
}

function sendPerson(app, cell) {
  const { episode } = app;
  for (let i = 0; i < episode.people; i++) {
    const far = Math.hypot(episode.walking[3 * i] - cell.x, episode.walking[3 * i + 1] - cell.y);
    if (far < Math.max(0.5, 12 / app.view.scale)) return send({ do: "leave", person: i });
  }
  return send({ do: "person", cell: [cell.row, cell.column] });
}

// The cells that a stroke will change, until the world shows them.
function drawStroke(app) {
  if (!app.stroke || app.hand !== "shelves") return;
  const [canvas] = app.canvases;
  const context = canvas.getContext("2d"), place = placeOf(canvas, app.episode, app.view), inks = inksOf(app.dark);
  const cell = app.episode.cell * place.scale;
  context.fillStyle = app.stroke.stand ? inks.rack : inks.floor;
  context.globalAlpha = 0.75;
  for (const [row, column] of app.stroke.cells.values()) {
    context.fillRect(place.left + column * cell, place.top + row * cell, cell, cell);
  }
  context.globalAlpha = 1;
}
