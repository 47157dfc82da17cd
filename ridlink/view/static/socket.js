// The WebSocket: JSON both ways, opened again with back-off when it breaks, or when nothing comes any more: a server that
// stands still, or a way to it that is cut, breaks no connection for minutes, and what is shown would look live.

const PATIENCE_MS = [500, 1000, 2000, 4000, 8000];
const SILENT_MS = 10_000; // the server says how it is every second
const FULL = 1013; // the server has as many clients as it takes

export class Socket {
  #socket = null;
  #failures = 0;
  #silent = 0;

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
    this.#wait();
    socket.onopen = () => this.onState("open");
    socket.onmessage = (event) => {
      this.#failures = 0;
      this.#wait();
      let message;
      try {
        message = JSON.parse(event.data);
      } catch {
        return;
      }
      this.onMessage(message);
    };
    socket.onclose = (event) => this.#lost(event.code === FULL ? "full" : "lost");
  }

  // For the next word; each begins the time anew.
  #wait() {
    clearTimeout(this.#silent);
    this.#silent = setTimeout(() => this.#lost("lost"), SILENT_MS);
  }

  #lost(state) {
    clearTimeout(this.#silent);
    this.#socket.onopen = this.#socket.onmessage = this.#socket.onclose = null;
    this.#socket.close();
    this.onState(state);
    const wait = PATIENCE_MS[Math.min(this.#failures, PATIENCE_MS.length - 1)];
    this.#failures += 1;
    setTimeout(() => this.#open(), wait * (0.8 + 0.4 * Math.random()));
  }
}
