// One floor on its canvas: everything of one moment, layer upon layer.

const LIGHT = {
  name: "light", ground: "#e9ebee", floor: "#f8f7f3", seam: "#eeece6", pick: "#d3cdc0", station: "#cfe6e8",
  stationEdge: "#6fa3a9", rack: "#6f7a87", boxes: ["#aab3be", "#b9b6ac", "#9ca7b4", "#b3bbc4"], lid: "#ffffff38",
  shade: "#2b303826", raised: [224, 150, 70], sunken: [80, 140, 205], oneWay: "#8796a6", parked: "#b4b9c0",
  nose: "#ffffff", wheel: "#15181c", load: "#d9b98a", strap: "#a9834f", number: "#14181e",
  lidar: "#0072b21c", ray: "#0072b24d", hit: "#0072b2", arrow: "#262c36", halo: "#ffffffd9", sign: "#ffffff",
  vest: "#e69f00", vestEdge: "#2b2006", helmet: "#ffffff",
  chosen: "#14181e", near: "#c86400", deadlock: "#6a0096",
};
const DARK = {
  name: "dark", ground: "#0d1014", floor: "#20252c", seam: "#272d35", pick: "#434c57", station: "#1f444a",
  stationEdge: "#4f8f97", rack: "#3c4550", boxes: ["#56606d", "#5f605d", "#4d5865", "#5d6773"], lid: "#ffffff14",
  shade: "#00000059", raised: [230, 150, 70], sunken: [80, 150, 230], oneWay: "#6d7b8a", parked: "#59616b",
  nose: "#f4f6f8", wheel: "#0a0c0f", load: "#d2b07e", strap: "#94703f", number: "#0b0e12",
  lidar: "#56b4e924", ray: "#56b4e95c", hit: "#7cc8f2", arrow: "#f1f4f7", halo: "#0b0e12d9", sign: "#ffffff",
  vest: "#e69f00", vestEdge: "#2b2006", helmet: "#ffffff",
  chosen: "#ffffff", near: "#ff9a2e", deadlock: "#c77dff",
};

function inksOf(dark) {
  return dark ? DARK : LIGHT;
}

// Where the floor lies on a canvas under a view.
function placeOf(canvas, episode, view) {
  const ratio = canvas.ratio;
  const scale = view.scale * ratio;
  const left = canvas.width / 2 - view.x * scale;
  const bottom = canvas.height / 2 + view.y * scale;
  return { scale, left, bottom, top: bottom - episode.height * scale };
}

function drawStage(canvas, episode, app) {
  sizeCanvas(canvas);
  const context = canvas.getContext("2d", { alpha: false });
  const place = placeOf(canvas, episode, app.view);
  const style = styleOf(canvas, episode, app);
  context.setTransform(1, 0, 0, 1, 0, 0);
  drawFloor(context, episode, place, style.inks);
  if (app.layers.trails) drawTrails(context, episode, place, style);
  if (app.layers.routes) drawRoutes(context, episode, place, style);
  if (app.layers.goals) drawGoals(context, episode, place, style);
  if (style.robot >= 0 && app.layers.lidar) drawLidar(context, episode, place, style);
  drawRobots(context, episode, place, style);
  drawPeople(context, episode, place, style);
  if (app.layers.waiting) drawWaiting(context, episode, place, style);
  if (style.robot >= 0) drawChosen(context, episode, place, style);
  drawEvents(context, episode, place, style);
  drawRuler(context, canvas, place, style);
}

function styleOf(canvas, episode, app) {
  const inks = inksOf(app.dark);
  return {
    inks,
    colours: episode.colours,
    edges: episode.edges,
    marks: { collision: app.colours.contact, near: inks.near, deadlock: inks.deadlock, waiting: app.colours.waiting },
    ratio: canvas.ratio,
    robot: app.robot < episode.robots ? app.robot : -1,
    waiting: app.layers.waiting,
    numbers: app.layers.numbers,
    still: app.still,
    font: "system-ui, sans-serif",
  };
}

// A scale bar in the lower left corner, of a round number of metres.
function drawRuler(context, canvas, place, style) {
  const goal = 90 * style.ratio;
  const metres = [1, 2, 5, 10, 20, 50, 100, 200].find((length) => length * place.scale > 0.6 * goal) || 500;
  const x = 14 * style.ratio, y = canvas.height - 14 * style.ratio, long = metres * place.scale;
  context.lineCap = "butt";
  for (const [wide, ink] of [[4, style.inks.halo], [1.5, style.inks.arrow]]) {
    context.strokeStyle = ink;
    context.lineWidth = wide * style.ratio;
    context.beginPath();
    context.moveTo(x, y - 5 * style.ratio);
    context.lineTo(x, y);
    context.lineTo(x + long, y);
    context.lineTo(x + long, y - 5 * style.ratio);
    context.stroke();
  }
  context.font = `${11 * style.ratio}px ${style.font}`;
  context.textAlign = "left";
  context.textBaseline = "alphabetic";
  context.lineWidth = 3 * style.ratio;
  context.strokeStyle = style.inks.halo;
  context.strokeText(`${metres} m`, x + 5 * style.ratio, y - 5 * style.ratio);
  context.fillStyle = style.inks.arrow;
  context.fillText(`${metres} m`, x + 5 * style.ratio, y - 5 * style.ratio);
}
