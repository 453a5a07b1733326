// What part of the floor is shown: shared by both floors, so that they stay in step in place as well as in time.

class View {
  constructor() {
    this.x = 0; // [m], in the middle
    this.y = 0;
    this.scale = 10; // [CSS px/m]
    this.least = 1;
    this.most = 160;
  }

  fit(episode, width, height) {
    this.least = Math.min(width / (episode.width + 1), height / (episode.height + 1));
    this.scale = this.least;
    this.x = episode.width / 2;
    this.y = episode.height / 2;
  }

  // Zoom by a factor, the point (px, py) off the middle of the canvas staying where it is.
  zoom(factor, px, py) {
    const scale = Math.min(Math.max(this.scale * factor, this.least * 0.8), this.most);
    this.x += px / this.scale - px / scale;
    this.y -= py / this.scale - py / scale;
    this.scale = scale;
  }

  pan(dx, dy) {
    this.x -= dx / this.scale;
    this.y += dy / this.scale;
  }
}

// Layout is asked for the size of a canvas once, and again only after `sizesChanged`: asking makes the browser lay out.
let sizeRound = 0;

function sizesChanged() {
  sizeRound++;
}

// Make a canvas as large as it is shown, in device pixels; returns whether its size has changed.
function sizeCanvas(canvas) {
  if (canvas.sizedIn === sizeRound) return false;
  canvas.sizedIn = sizeRound;
  canvas.ratio = Math.min(window.devicePixelRatio || 1, 2);
  const width = Math.max(1, Math.round(canvas.clientWidth * canvas.ratio));
  const height = Math.max(1, Math.round(canvas.clientHeight * canvas.ratio));
  const changed = canvas.width !== width || canvas.height !== height;
  if (changed) Object.assign(canvas, { width, height });
  return changed;
}
