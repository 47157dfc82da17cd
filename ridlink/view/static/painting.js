// A worker that paints the plan beside the page: first it is given the canvases, then what to paint, again and again.

import { Painter } from "./painter.js";

let painter = null;

addEventListener("message", ({ data }) => {
  if (painter) {
    painter.paint(data);
    postMessage("painted");
  } else painter = new Painter(data);
});
