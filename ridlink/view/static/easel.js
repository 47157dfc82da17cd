// The two canvases of the plan, painted by a worker where the browser lets it: then no frame of the page waits for them.

import { canvasIn } from "./canvas.js";
import { Painter } from "./painter.js";

export class Easel {
  #canvases = {};
  #worker = null;
  #painter = null;

  free = true; // whether the last picture is painted: there is no queue

  // onAnew() when the canvases are others than before, which know nothing yet.
  constructor(element, onAnew) {
    this.element = element;
    this.onAnew = onAnew;
    this.#put();
    try {
      this.#hire();
    } catch {
      this.#paintHere();
    }
  }

  // What is in `given` goes away with the message.
  paint(message, given) {
    if (!this.#worker) {
      this.#painter.paint(message);
      return;
    }
    this.free = false;
    this.#worker.postMessage(message, given);
  }

  #put() {
    for (const name of ["ground", "traffic"]) {
      this.#canvases[name]?.remove();
      this.#canvases[name] = canvasIn(this.element, name);
    }
  }

  #hire() {
    const worker = new Worker(new URL("painting.js", import.meta.url), { type: "module" });
    worker.addEventListener("message", () => { this.free = true; });
    worker.addEventListener("error", () => this.#paintHere());
    const away = Object.entries(this.#canvases).map(([name, canvas]) => [name, canvas.transferControlToOffscreen()]);
    worker.postMessage(Object.fromEntries(away), away.map(([, canvas]) => canvas));
    this.#worker = worker;
  }

  #paintHere() {
    this.#worker?.terminate();
    this.#worker = null;
    this.#put(); // a canvas that was given away does not come back
    this.#painter = new Painter(this.#canvases);
    this.free = true;
    this.onAnew();
  }
}
