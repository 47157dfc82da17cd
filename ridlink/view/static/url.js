// The address of the page holds the instant, the vehicle and the definition: ?t=12.3&v=NAME&d=candidate2

export function readUrl(search = location.search) {
  const given = new URLSearchParams(search);
  const t = given.get("t");
  return {
    t: t !== null && t.trim() !== "" && Number.isFinite(Number(t)) ? Number(t) : null,
    vehicle: given.get("v"),
    definition: given.get("d"),
  };
}

export function urlOf({ t, vehicle, definition }) {
  const parts = new URLSearchParams();
  if (t !== null) parts.set("t", t.toFixed(1));
  if (vehicle !== null) parts.set("v", vehicle);
  if (definition) parts.set("d", definition);
  const text = parts.toString();
  return text ? `?${text}` : location.pathname;
}

// Browsers bear only so many changes of the address: at most one in half a second.
export class UrlKeeper {
  #written = location.search;
  #at = 0;

  keep(state, now) {
    if (now - this.#at < 500) return;
    const url = urlOf(state);
    if (url === this.#written) return;
    this.#written = url;
    this.#at = now;
    history.replaceState(null, "", url);
  }
}
