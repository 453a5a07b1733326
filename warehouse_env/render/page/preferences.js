// What the policy would like to do: probability of each speed level over time, and of every command now.

function buildPreferences(app) {
  const box = document.querySelector("#preferences");
  const episode = app.replays[app.active];
  box.hidden = app.robot < 0 || !episode.columns.liked;
  app.preferences = null;
  if (box.hidden) return;
  const grid = document.querySelector("#commands");
  grid.replaceChildren();
  const cells = buildCommands(grid, episode);
  const canvas = document.querySelector("#levels");
  app.preferences = { show: () => showPreferences(app, episode, cells, canvas) };
}

// A table: a row a speed level, the fastest on top; a column an offset, left of the route on the left.
function buildCommands(grid, episode) {
  const offsets = order(episode.offsets, (a, b) => b - a);
  const levels = order(episode.levels, (a, b) => b - a);
  const head = grid.createTHead().insertRow();
  head.append(element("th", "", "m/s \\ m"));
  for (const n of offsets) head.append(element("th", "number", signed(episode.offsets[n])));
  const body = grid.createTBody();
  const cells = [];
  for (const level of levels) {
    const row = body.insertRow();
    row.append(element("th", "number", signed(episode.levels[level])));
    for (const n of offsets) {
      const cell = element("td");
      cells.push({ action: level * episode.offsets.length + n, cell });
      row.append(cell);
    }
  }
  return cells;
}

function order(values, compare) {
  return values.map((_, k) => k).sort((a, b) => compare(values[a], values[b]));
}

function signed(value) {
  return value > 0 ? `+${value}` : `${value}`.replace("-", "−");
}

function liked(episode, robot, action, frame) {
  const column = episode.columns.liked;
  const actions = episode.levels.length * episode.offsets.length;
  return column.values[(robot * actions + action) * episode.frames + frame] * column.unit;
}

function showPreferences(app, episode, cells, canvas) {
  const robot = app.robot;
  for (const { action, cell } of cells) {
    const share = liked(episode, robot, action, episode.moment);
    cell.style.background = `color-mix(in srgb, var(--accent) ${Math.round(100 * Math.sqrt(share))}%, transparent)`;
    cell.textContent = share >= 0.005 ? Math.round(100 * share) : "";
    cell.classList.toggle("strong", share > 0.3);
  }
  const offsets = episode.offsets.length;
  const sums = (frame) => episode.levels.map((_, level) => {
    let sum = 0;
    for (let n = 0; n < offsets; n++) sum += liked(episode, robot, level * offsets + n, frame);
    return sum;
  });
  const ranked = order(episode.levels, (a, b) => a - b);
  const levels = ranked.map((level, n) => ({
    share: (frame) => {
      const all = sums(frame);
      return all[level] / (all.reduce((a, b) => a + b, 0) || 1);
    },
    ink: app.css.levels[Math.round((n * (app.css.levels.length - 1)) / Math.max(1, ranked.length - 1))],
  }));
  drawShares(canvas, episode, levels, app);
}
