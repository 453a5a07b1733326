// What every page is built of once, around its episodes.

// A colour #rrggbb with a share of another.
function mixed(colour, other, share) {
  const parts = [1, 3, 5].map((at) => {
    const [a, b] = [colour, other].map((one) => parseInt(one.slice(at, at + 2), 16));
    return Math.round(a + (b - a) * share).toString(16).padStart(2, "0");
  });
  return `#${parts.join("")}`;
}

// Give an episode's robots their colours and outlines.
function dress(episode, colours) {
  episode.colours = colours.slice(0, episode.robots);
  episode.edges = episode.colours.map((colour) => mixed(colour, "#000000", 0.55));
  episode.shapes = episode.bodies.map(shapesOf); // of each kind
}

function buildFloors(replays) {
  const holder = document.querySelector("#floors");
  for (const [k, episode] of replays.entries()) {
    const figure = element("figure", "floor");
    const caption = element("figcaption");
    const dot = element("i", "dot");
    dot.style.background = `var(--series-${k})`;
    caption.append(dot, element("b", "", episode.name), element("span", "", episode.about));
    const canvas = element("canvas");
    canvas.setAttribute("role", "img");
    canvas.setAttribute("aria-label", `the floor with the robots of ${episode.name}`);
    figure.append(canvas, caption);
    holder.append(figure);
  }
  holder.classList.toggle("two", replays.length > 1);
}

function buildLegend(app) {
  for (const canvas of document.querySelectorAll("#legend canvas")) {
    sizeCanvas(canvas);
    const context = canvas.getContext("2d");
    const ratio = canvas.ratio;
    context.clearRect(0, 0, canvas.width, canvas.height);
    const style = { ...styleOf(canvas, app.replays[0], app), ratio };
    drawSign(context, canvas.dataset.sign, canvas.width / 2, canvas.height / 2, 0.42 * canvas.height, style);
  }
}

// Keep canvases as large as they are shown, and the whole floor in view where it was.
function watchSizes(app) {
  let size = "";
  const watch = new ResizeObserver(() => {
    const [canvas] = app.canvases;
    const now = `${canvas.clientWidth} ${canvas.clientHeight}`;
    const whole = app.view.scale <= app.view.least * 1.001;
    if (now !== size && whole && !app.following) app.fit();
    size = now;
    sizesChanged();
    app.changed = true;
  });
  for (const place of ["#floors", "aside", "#charts"]) watch.observe(document.querySelector(place));
}

// Everything that asks for a first look: floors that can be moved, the theme, sizes.
function build(app) {
  const dark = matchMedia("(prefers-color-scheme: dark)");
  app.canvases.forEach((canvas, k) => buildPointer(app, canvas, k));
  app.theme(dark.matches);
  dark.addEventListener("change", () => app.theme(dark.matches));
  app.fit();
  watchSizes(app);
  document.querySelector("#legend").addEventListener("toggle", () => {
    sizesChanged();
    buildLegend(app);
  });
}
