// Small charts of numbers over time, with the moment shown in the middle.

// Paint series into a canvas. chart: { lines: [{ value(frame), last, seconds, ink }], low, high }.
function drawChart(canvas, chart, app) {
  sizeCanvas(canvas);
  const context = canvas.getContext("2d");
  const { width, height } = canvas;
  const ratio = canvas.ratio;
  const span = app.span();
  const paper = {
    x: (seconds) => ((seconds - span.from) / (span.to - span.from)) * width,
    y: (value) => height - 3 * ratio - ((value - chart.low) / (chart.high - chart.low || 1)) * (height - 6 * ratio),
  };
  context.clearRect(0, 0, width, height);
  drawAxis(context, chart, paper, span, app, ratio);
  for (const line of chart.lines) drawLine(context, line, paper, span, ratio);
  const now = paper.x(app.frame * app.seconds);
  context.fillStyle = app.css.ink;
  context.fillRect(now - ratio / 2, 0, ratio, height);
}

function drawAxis(context, chart, paper, span, app, ratio) {
  context.strokeStyle = app.css.line;
  context.lineWidth = ratio;
  context.beginPath();
  if (chart.low <= 0 && chart.high >= 0) {
    const y = Math.round(paper.y(0)) + 0.5;
    context.moveTo(0, y);
    context.lineTo(context.canvas.width, y);
  }
  context.stroke();
  // the time before the start and after the end is no data
  context.fillStyle = app.css.line;
  context.globalAlpha = 0.5;
  const begin = paper.x(0), end = paper.x(app.last * app.seconds);
  if (begin > 0) context.fillRect(0, 0, begin, context.canvas.height);
  if (end < context.canvas.width) context.fillRect(end, 0, context.canvas.width - end, context.canvas.height);
  context.globalAlpha = 1;
}

function drawLine(context, line, paper, span, ratio) {
  const first = Math.max(0, Math.floor(span.from / line.seconds));
  const last = Math.min(line.last, Math.ceil(span.to / line.seconds));
  const stride = Math.max(1, Math.floor((last - first) / 700));
  context.beginPath();
  for (let k = first; k <= last; k += stride) context.lineTo(paper.x(k * line.seconds), paper.y(line.value(k)));
  context.strokeStyle = line.ink;
  context.lineWidth = 1.5 * ratio;
  context.lineJoin = "round";
  context.stroke();
}

// Shares of the speed levels over time, one upon the other, the slowest below; levels: [{ share(frame), ink }].
function drawShares(canvas, episode, levels, app) {
  sizeCanvas(canvas);
  const context = canvas.getContext("2d");
  const { width, height } = canvas;
  const span = app.span();
  context.clearRect(0, 0, width, height);
  const first = Math.max(0, Math.floor(span.from / episode.seconds));
  const last = Math.min(episode.last, Math.ceil(span.to / episode.seconds));
  const x = (k) => ((k * episode.seconds - span.from) / (span.to - span.from)) * width;
  const stride = Math.max(1, Math.floor((last - first) / 350));
  for (let k = first; k <= last; k += stride) {
    let below = 0;
    for (const level of levels) {
      const share = level.share(k);
      context.fillStyle = level.ink;
      context.fillRect(x(k), height * (1 - below - share), x(k + stride) - x(k) + 0.6, height * share);
      below += share;
    }
  }
  context.fillStyle = app.css.ink;
  const ratio = canvas.ratio;
  context.fillRect(((app.frame * app.seconds - span.from) / (span.to - span.from)) * width - ratio / 2, 0, ratio, height);
}
