// Canvases that are as sharp as the screen, and drawn on in CSS pixels.

export function canvasIn(element, name) {
  const canvas = document.createElement("canvas");
  canvas.className = `plan-canvas ${name}`;
  canvas.setAttribute("aria-hidden", "true");
  element.append(canvas);
  return canvas;
}

// Pixels of a canvas in a CSS pixel; a worker does not know.
export function sharpness() { return Math.min(2, devicePixelRatio || 1); }

// The canvas in the size of the view, cleared.
export function prepare(canvas, { width, height, ratio = sharpness() }) {
  const [w, h] = [Math.round(width * ratio), Math.round(height * ratio)];
  if (canvas.width !== w || canvas.height !== h) {
    canvas.width = w;
    canvas.height = h;
  }
  const context = canvas.getContext("2d");
  context.setTransform(ratio, 0, 0, ratio, 0, 0);
  context.clearRect(0, 0, width, height);
  return context;
}
