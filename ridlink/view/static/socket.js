// The WebSocket: JSON both ways, opened again with back-off when it breaks.

const PATIENCE_MS = [500, 1000, 2000, 4000, 8000];
const FULL = 1013; // the server has as many clients as it takes

export class Socket {
  #socket = null;
  #failures = 0;

  // onMessage(message) for every message, onState("open" | "lost" | "full") when the connection changes.
  constructor(url, onMessage, onState) {
    this.url = url;
    this.onMessage = onMessage;
    this.onState = onState;
    this.#open();
  }

  // False if nobody is there to take it.
  send(request) {
    if (this.#socket?.readyState !== WebSocket.OPEN) return false;
    this.#socket.send(JSON.stringify(request));
    return true;
  }

  #open() {
    const socket = new WebSocket(this.url);
    this.#socket = socket;
    socket.onopen = () => {
      this.#failures = 0;
      this.onState("open");
    };
    socket.onmessage = (event) => {
      let message;
      try {
        message = JSON.parse(event.data);
      } catch {
        return;
      }
      this.onMessage(message);
    };
    socket.onclose = (event) => {
      this.onState(event.code === FULL ? "full" : "lost");
      const wait = PATIENCE_MS[Math.min(this.#failures, PATIENCE_MS.length - 1)];
      this.#failures += 1;
      setTimeout(() => this.#open(), wait * (0.8 + 0.4 * Math.random()));
    };
  }
}
