// The time line: how many wait, and when something happened, a row an episode; drag to scrub.

const ROW = 30; // [CSS px]
const KINDS = ["deadlock", "near", "collision"]; // what lies on top comes last

function buildTimeline(app) {
  const canvas = document.querySelector("#timeline");
  canvas.style.height = `${ROW * app.replays.length}px`;
  const seek = (event) => {
    const share = Math.min(Math.max(event.offsetX / canvas.clientWidth, 0), 1);
    app.seek(Math.round(share * app.last));
  };
  canvas.addEventListener("pointerdown", (event) => {
    canvas.setPointerCapture(event.pointerId);
    app.scrubbing = true;
    seek(event);
  });
  canvas.addEventListener("pointermove", (event) => {
    if (app.scrubbing) seek(event);
    canvas.title = titleAt(app, canvas, event);
  });
  for (const end of ["pointerup", "pointercancel"]) canvas.addEventListener(end, () => (app.scrubbing = false));
  canvas.setAttribute("aria-valuemax", Math.round(app.last * app.seconds));
}

function titleAt(app, canvas, event) {
  const seconds = (event.offsetX / canvas.clientWidth) * app.last * app.seconds;
  const near = (4 / canvas.clientWidth) * app.last * app.seconds;
  const episode = app.replays[Math.min(Math.floor(event.offsetY / ROW), app.replays.length - 1)];
  const found = episode.events.filter(
    (e) => e.frame * episode.seconds - near <= seconds && e.end * episode.seconds + near >= seconds,
  );
  return [`${seconds.toFixed(1)} s`, ...found.slice(0, 8).map(sentenceOf)].join("\n");
}

function sentenceOf(event) {
  const names = { collision: "collision", near: "near miss", deadlock: "deadlock" };
  return `${names[event.kind]}: ${[...event.robots, ...(event.what ? [event.what] : [])].join(" and ")}`;
}

function drawTimeline(app) {
  const canvas = document.querySelector("#timeline");
  const resized = sizeCanvas(canvas);
  const ratio = canvas.ratio;
  if (resized || !app.timePicture) app.timePicture = timePicture(app, canvas, ratio);
  const context = canvas.getContext("2d");
  context.clearRect(0, 0, canvas.width, canvas.height);
  context.drawImage(app.timePicture, 0, 0);
  const x = app.last ? (app.frame / app.last) * canvas.width : 0;
  context.fillStyle = app.css.accent;
  context.globalAlpha = 0.12;
  context.fillRect(0, 0, x, canvas.height);
  context.globalAlpha = 1;
  context.fillRect(Math.min(x, canvas.width - 2 * ratio) - ratio, 0, 2.5 * ratio, canvas.height);
}

function sayTime(app) {
  const canvas = document.querySelector("#timeline");
  canvas.setAttribute("aria-valuenow", Math.round(app.frame * app.seconds));
  canvas.setAttribute("aria-valuetext", `${(app.frame * app.seconds).toFixed(1)} seconds`);
}

// All but the place in time, painted once for a size and theme.
function timePicture(app, canvas, ratio) {
  const picture = document.createElement("canvas");
  Object.assign(picture, { width: canvas.width, height: canvas.height });
  const context = picture.getContext("2d");
  const inks = inksOf(app.dark);
  const marks = { collision: app.colours.contact, near: inks.near, deadlock: inks.deadlock };
  for (const [row, episode] of app.replays.entries()) {
    const paper = {
      top: row * ROW * ratio, high: ROW * ratio, ratio,
      x: (frame) => (frame * episode.seconds * picture.width) / (app.last * app.seconds || 1),
    };
    drawWaitingShare(context, episode, paper, app.css);
    for (const kind of KINDS) {
      const events = episode.events.filter((event) => event.kind === kind);
      for (const event of events) drawMark(context, event, paper, marks[kind]);
    }
  }
  return picture;
}

function drawWaitingShare(context, episode, paper, css) {
  const base = paper.top + paper.high - 1 * paper.ratio;
  const most = paper.high - 6 * paper.ratio;
  context.beginPath();
  context.moveTo(0, base);
  for (let k = 0; k < episode.frames; k++) {
    context.lineTo(paper.x(k), base - (most * episode.waiting[k]) / episode.robots);
  }
  context.lineTo(paper.x(episode.last), base);
  context.fillStyle = css.waitingShare;
  context.fill();
  context.fillStyle = css.line;
  context.fillRect(0, base, context.canvas.width, paper.ratio);
}

// Collisions are tall lines with a dot, near misses short lines from above, deadlocks bars as long as they last.
function drawMark(context, event, paper, ink) {
  const x = paper.x(event.frame), { top, high, ratio } = paper;
  context.fillStyle = ink;
  if (event.kind === "deadlock") {
    context.fillRect(x, top + high - 6 * ratio, Math.max(3 * ratio, paper.x(event.end) - x), 5 * ratio);
  } else if (event.kind === "near") {
    context.fillRect(x - ratio / 2, top + 2 * ratio, 1.5 * ratio, 0.36 * high);
  } else {
    context.fillRect(x - ratio / 2, top + 2 * ratio, 2 * ratio, high - 4 * ratio);
    disc(context, x + ratio / 2, top + 5 * ratio, 3.2 * ratio, ink);
  }
}
