// Buttons, keys, mouse and fingers.

const LAYERS = { routes: "r", goals: "g", trails: "t", lidar: "l", waiting: "w", numbers: "n" };

// Keys of every page: what they do, as the help says it, and how.
const KEYS = [
  { keys: ["+", "="], shown: "+", says: "zoom in", act: (app) => app.zoom(1.3) },
  { keys: ["-"], shown: "−", says: "zoom out", act: (app) => app.zoom(1 / 1.3) },
  { keys: ["0"], shown: "0", says: "show the whole floor", act: (app) => app.fit() },
  { keys: [","], shown: ",", says: "previous robot", act: (app) => app.choose(app.robot - 1) },
  { keys: ["."], shown: ".", says: "next robot", act: (app) => app.choose(app.robot + 1) },
  { keys: ["/"], shown: "/", says: "find a robot by its number", act: () => document.querySelector("#find").focus() },
  { keys: ["f"], shown: "F", says: "follow the chosen robot", act: (app) => app.follow(!app.following) },
  ...Object.entries(LAYERS).map(([layer, key]) => ({
    keys: [key], shown: key.toUpperCase(), says: `show or hide ${layer}`, act: (app) => app.layer(layer),
  })),
  { keys: ["d"], shown: "D", says: "switch between dark and light", act: (app) => app.theme(!app.dark) },
  { keys: ["?", "h"], shown: "?", says: "show this help", act: (app) => app.help() },
  { keys: ["Escape"], shown: "Esc", says: "clear the choice", act: (app) => app.choose(-1) },
];

function buildKeys(app, keys) {
  const list = document.querySelector("#keys");
  for (const { shown, says } of keys) list.append(element("kbd", "", shown), element("span", "", says));
  document.addEventListener("keydown", (event) => {
    const writes = event.target.matches("select, input:not([type=range])");
    const slides = event.target.matches("input") && /^(Arrow|Home|End|Page)/.test(event.key);
    if (event.ctrlKey || event.metaKey || event.altKey || writes || slides) return;
    if (event.key === " " && event.target.matches("button")) event.target.blur();
    const arrow = event.shiftKey && event.key.startsWith("Arrow");
    const pressed = arrow ? `Shift+${event.key}` : event.key.length === 1 ? event.key.toLowerCase() : event.key;
    const found = keys.find((one) => one.keys.includes(pressed));
    const dialog = document.querySelector("#help");
    if (!found || (dialog.open && pressed !== "?" && pressed !== "h")) return;
    event.preventDefault();
    found.act(app);
  });
}

// acts: what the page's own buttons do, by their ids.
function buildButtons(app, acts) {
  const shared = {
    in: () => app.zoom(1.4), out: () => app.zoom(1 / 1.4), fit: () => app.fit(),
    theme: () => app.theme(!app.dark), ask: () => app.help(), follow: () => app.follow(!app.following),
    previous: () => app.choose(app.robot - 1), next: () => app.choose(app.robot + 1),
  };
  for (const [id, act] of Object.entries({ ...shared, ...acts })) document.getElementById(id).addEventListener("click", act);
  const find = document.querySelector("#find");
  find.addEventListener("input", () => find.setCustomValidity(""));
  find.addEventListener("change", () => {
    const found = app.find(find.value);
    if (found) {
      find.value = "";
      find.blur();
    }
    find.setCustomValidity(found || !find.value ? "" : `robot numbers run from 0 to ${app.replays[app.active].robots - 1}`);
    find.reportValidity();
  });
  const span = document.querySelector("#span");
  span.addEventListener("change", () => app.change({ chartSeconds: Number(span.value) }));
  for (const layer of Object.keys(LAYERS)) {
    const button = element("button", "chip", layer);
    button.dataset.layer = layer;
    button.title = `${layer} (${LAYERS[layer].toUpperCase()})`;
    button.addEventListener("click", () => app.layer(layer));
    document.querySelector("#layers").append(button);
  }
}

function showLayers(app) {
  for (const button of document.querySelectorAll("[data-layer]")) {
    button.setAttribute("aria-pressed", app.layers[button.dataset.layer]);
  }
}

// Drag to pan, wheel or two fingers to zoom, a click or tap to choose a robot.
function buildPointer(app, canvas, index) {
  const fingers = new Map();
  let moved = 0;
  const offMiddle = (x, y) => [x - canvas.clientWidth / 2, y - canvas.clientHeight / 2];
  canvas.addEventListener("pointerdown", (event) => {
    canvas.setPointerCapture(event.pointerId);
    if (!fingers.size) moved = 0;
    fingers.set(event.pointerId, [event.offsetX, event.offsetY]);
  });
  canvas.addEventListener("pointermove", (event) => {
    const before = fingers.get(event.pointerId);
    if (!before) return;
    const now = [event.offsetX, event.offsetY];
    moved += Math.hypot(now[0] - before[0], now[1] - before[1]);
    if (fingers.size === 2) pinch(app, fingers, event.pointerId, now, offMiddle);
    if (moved > 4 || fingers.size > 1) app.pan((now[0] - before[0]) / fingers.size, (now[1] - before[1]) / fingers.size);
    fingers.set(event.pointerId, now);
  });
  const lift = (event) => {
    fingers.delete(event.pointerId);
    if (event.type === "pointerup" && moved <= 4 && !fingers.size) app.chooseAt(index, event.offsetX, event.offsetY);
  };
  for (const end of ["pointerup", "pointercancel"]) canvas.addEventListener(end, lift);
  canvas.addEventListener("wheel", (event) => {
    event.preventDefault();
    const lines = event.deltaMode === 1 ? 16 : 1;
    app.zoom(Math.exp(-0.0016 * lines * event.deltaY), ...offMiddle(event.offsetX, event.offsetY));
  }, { passive: false });
}

function pinch(app, fingers, id, now, offMiddle) {
  const [other] = [...fingers].filter(([key]) => key !== id).map(([, place]) => place);
  const before = fingers.get(id);
  const ratio = Math.hypot(now[0] - other[0], now[1] - other[1]) / Math.hypot(before[0] - other[0], before[1] - other[1]);
  if (Number.isFinite(ratio) && ratio > 0) app.zoom(ratio, ...offMiddle((now[0] + other[0]) / 2, (now[1] + other[1]) / 2));
}
