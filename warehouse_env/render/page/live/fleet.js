// How all robots do, second by second, over the last five minutes.

const KEPT_SAMPLES = 900; // one a second
const SHOWN_SECONDS = 300;
const FLEET = [
  { title: "goals per robot-hour", columns: [1], least: 10, say: ([goals]) => fixed(goals, 0) },
  {
    title: "", spoken: "shares of waiting and standing robots", names: ["waiting", "standing"], columns: [2, 3], least: 0.25,
    say: ([waiting, standing]) => `${fixed(100 * waiting, 0)}, ${fixed(100 * standing, 0)}%`,
  },
  { title: "contacts since the start", columns: [4], least: 1, say: ([contacts]) => `${contacts}` },
];

function buildFleet(app) {
  app.fleet = FLEET.map((chart) => {
    const box = element("div", "chart"), row = element("div", "row"), title = element("span", "", chart.title);
    (chart.names ?? []).forEach((name, k) => {
      const key = element("i", "key");
      key.style.borderColor = `var(--series-${k})`;
      title.append(key, name);
    });
    const output = element("output"), canvas = element("canvas");
    canvas.setAttribute("role", "img");
    canvas.setAttribute("aria-label", `${chart.spoken ?? chart.title} over the last five minutes`);
    row.append(title, output);
    box.append(row, canvas);
    document.querySelector("#fleet").append(box);
    return { ...chart, canvas, output };
  });
}

function showFleet(app) {
  const { samples } = app.episode;
  const last = samples.length - 1;
  const to = Math.max(last, SHOWN_SECONDS);
  const time = { frame: last, seconds: 1, last, css: app.css, span: () => ({ from: to - SHOWN_SECONDS, to }) };
  for (const { canvas, output, columns, say, least } of app.fleet) {
    const shown = samples.slice(-SHOWN_SECONDS - 1);
    const high = Math.max(least, ...shown.flatMap((sample) => columns.map((k) => sample[k])));
    const lines = columns.map((k, n) => ({ value: (at) => samples[at][k], last, seconds: 1, ink: app.css.series[n] }));
    drawChart(canvas, { lines, low: 0, high }, time);
    output.textContent = last < 0 ? "" : say(columns.map((k) => samples[last][k]));
  }
}
