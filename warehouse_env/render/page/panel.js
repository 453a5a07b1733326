// The side panel: totals of each episode, and the numbers of the chosen robot over time.

const TOTALS = ["goals", "collisions", "near misses"];

function element(tag, className, text) {
  const made = document.createElement(tag);
  if (className) made.className = className;
  if (text !== undefined) made.textContent = text;
  return made;
}

// A number to some decimals, with a true minus, and none before 0.
function fixed(value, decimals) {
  return value.toFixed(decimals).replace(/^-(?=[0.]*$)/, "").replace("-", "−");
}

function buildTotals(app) {
  const table = document.querySelector("#totals");
  const head = table.createTHead().insertRow();
  head.append(element("th", "", "so far"));
  for (const [k, episode] of app.replays.entries()) {
    const cell = element("th", "number");
    const dot = element("i", "dot");
    dot.style.background = `var(--series-${k})`;
    cell.append(dot, episode.name);
    head.append(cell);
  }
  const body = table.createTBody();
  for (const what of [...TOTALS, "deadlocks", "waiting now"]) {
    const row = body.insertRow();
    row.append(element("td", "", what));
    for (const _ of app.replays) row.append(element("td", "number"));
  }
}

function showTotals(app) {
  const rows = document.querySelector("#totals").tBodies[0].rows;
  for (const [k, episode] of app.replays.entries()) {
    const deadlocks = episode.events.filter((e) => e.kind === "deadlock" && e.frame <= episode.moment).length;
    const values = [...TOTALS.map((_, n) => episode.total(n, episode.moment)), deadlocks, episode.waiting[episode.moment]];
    values.forEach((value, n) => (rows[n].cells[k + 1].textContent = value.toLocaleString("en")));
  }
}

// What each chart shows: a title, what its number says, and the values of a robot (or of all, where none is chosen).
function chartsOf(app) {
  if (app.robot < 0) {
    return [
      { title: "robots waiting", value: (e) => (k) => e.waiting[k], say: (v) => `${v}` },
      { title: "mean speed", value: (e) => (k) => meanSpeed(e, k), say: (v) => `${fixed(v, 2)} m/s` },
      { title: "goals", value: (e) => (k) => e.total(0, k), say: (v) => `${v}` },
      { title: "collisions", value: (e) => (k) => e.total(1, k), say: (v) => `${v}` },
    ];
  }
  const i = app.robot;
  const degrees = 180 / Math.PI;
  return [
    { title: "speed", value: (e) => (k) => e.get("speed", i, k), say: (v) => `${fixed(v, 2)} m/s` },
    { title: "steering", value: (e) => (k) => e.get("steer", i, k) * degrees, say: (v) => `${fixed(v, 0)}°` },
    {
      title: "gap to the next robot", value: (e) => (k) => Math.min(gapsOf(e, i)[k], e.lidar.range),
      say: (v) => (v >= app.replays[app.active].lidar.range ? `over ${v} m` : `${fixed(v, 2)} m`),
    },
    ...app.terms.filter((term) => isUsed(app, term)).map((term) => ({
      title: `reward: ${term.replace("_", " ")}`, value: (e) => (k) => e.get(`reward ${term}`, i, k),
      say: (v) => fixed(v, 3), small: true,
    })),
  ];
}

function isUsed(app, term) {
  return app.replays.some((episode) => episode.columns[`reward ${term}`].values.some((value) => value !== 0));
}

function meanSpeed(episode, frame) {
  let sum = 0;
  for (let i = 0; i < episode.robots; i++) sum += Math.abs(episode.get("speed", i, frame));
  return sum / episode.robots;
}

// Make the charts' places anew: at the start, and when another robot is chosen.
function buildCharts(app) {
  const holder = document.querySelector("#charts");
  holder.replaceChildren();
  app.charts = app.chartsShown().map((chart) => {
    const box = element("div", chart.small ? "chart small" : "chart");
    const row = element("div", "row");
    const output = element("output");
    row.append(element("span", "", chart.title), output);
    const canvas = element("canvas");
    canvas.setAttribute("role", "img");
    canvas.setAttribute("aria-label", `${chart.title} over time`);
    canvas.addEventListener("pointerdown", (event) => seekInChart(app, canvas, event));
    box.append(row, canvas);
    holder.append(box);
    const lines = app.replays.map((episode, k) => ({ value: chart.value(episode), last: episode.last, seconds: episode.seconds, k }));
    return { ...chart, canvas, output, lines, ...rangeOf(lines) };
  });
  buildPreferences(app);
}

function rangeOf(lines) {
  let low = 0, high = 0;
  for (const line of lines) {
    for (let k = 0; k <= line.last; k++) {
      const value = line.value(k);
      low = Math.min(low, value);
      high = Math.max(high, value);
    }
  }
  return { low, high };
}

function seekInChart(app, canvas, event) {
  const span = app.span();
  const seconds = span.from + (event.offsetX / canvas.clientWidth) * (span.to - span.from);
  app.seek(Math.round(seconds / app.seconds));
}

function showCharts(app) {
  for (const chart of app.charts) {
    for (const line of chart.lines) line.ink = app.css.series[line.k];
    const active = app.replays[app.active];
    // the active one last, so that it lies on top
    const lines = [...chart.lines].sort((a, b) => (a.k === app.active) - (b.k === app.active));
    drawChart(chart.canvas, { ...chart, lines }, app);
    chart.output.textContent = chart.say(chart.lines[app.active].value(active.moment));
  }
  if (app.preferences) app.preferences.show();
}

function showRobot(app) {
  const chosen = app.robot >= 0;
  document.querySelector("#robot-name").textContent = chosen ? `Robot ${app.robot}` : "All robots";
  document.querySelector("#robot-state").textContent = chosen
    ? stateOf(app.replays[app.active], app.robot)
    : `Choose a robot on the floor to see what it senses${app.terms.length ? ", does and earns" : " and does"}.`;
  document.querySelector("#follow").setAttribute("aria-pressed", app.following && chosen);
  document.querySelector("#follow").disabled = !chosen;
  document.querySelector("#span").parentElement.hidden = !chosen;
}

// Whom a robot waits for, whom that one waits for, and so on to the first that waits for nobody.
function chainOf(episode, robot, frame) {
  const chain = [robot];
  let next = episode.get("waits_for", robot, frame);
  while (next >= 0 && !chain.includes(next)) {
    chain.push(next);
    next = episode.get("waits_for", next, frame);
  }
  const links = chain.slice(1).map((other) => `waits for ${other}`);
  return links.join(", which ") + (next >= 0 ? `, which waits for ${next}: a wait cycle` : "");
}

// One sentence about what a robot does now.
function stateOf(episode, robot) {
  const k = episode.moment;
  const said = [];
  if (episode.flag("silent", robot, k)) return "is silent";
  if (!episode.flag("alive", robot, k)) return episode.idle;
  const waits = episode.get("waits_for", robot, k), held = episode.get("held_by", robot, k);
  const yields = episode.get("yields_to", robot, k);
  if (episode.flag("touching", robot, k)) said.push("touches something");
  if (waits >= 0) said.push(chainOf(episode, robot, k));
  else if (episode.flag("served", robot, k)) said.push("is served at its place");
  else said.push(Math.abs(episode.now[5 * robot + 3]) > 0.05 ? "drives" : "stands");
  if (yields >= 0 && yields !== waits) said.push(`gives way to ${yields}`);
  if (held >= 0 && held !== waits) said.push(`is braked for ${held}`);
  said.push(episode.flag("loaded", robot, k) ? "with a load" : "empty");
  const route = episode.routes[episode.get("route", robot, k)];
  const left = route.length ? Math.max(0, route[route.length - 1] - episode.get("along", robot, k)) : 0;
  said.push(`${left.toFixed(1)} m to go`);
  return said.join(", ");
}
