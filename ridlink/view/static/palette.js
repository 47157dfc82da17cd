// The colours of the style sheet for what is drawn on canvases, and the choice between light and dark.

const NAMES = [
  "ground", "panel", "line", "edge", "text", "muted", "accent", "good", "warn", "alarm", "grid", "grid-strong",
  "grid-text", "vehicle", "stranger", "stale", "ring-airframe", "ring-error", "ring-displacement", "ring-edge", "trail",
  "truth", "velocity", "goal", "obstacle", "obstacle-edge", "clear", "near", "inside", "forbidden", "forbidden-edge",
  "strip-shade",
];
const KEPT_AS = "ridlink-theme";

export class Palette {
  constructor(onChange) {
    this.onChange = onChange;
    try {
      const kept = localStorage.getItem(KEPT_AS);
      if (kept === "light" || kept === "dark") document.documentElement.dataset.theme = kept;
    } catch { /* private mode: the choice lasts as long as the page */ }
    matchMedia("(prefers-color-scheme: dark)").addEventListener("change", () => this.read());
    this.read();
  }

  get dark() {
    const chosen = document.documentElement.dataset.theme;
    return chosen ? chosen === "dark" : matchMedia("(prefers-color-scheme: dark)").matches;
  }

  // The colours and the font alone, for whoever paints elsewhere.
  get colours() {
    const { onChange, ...colours } = this;
    return colours;
  }

  toggle() {
    const next = this.dark ? "light" : "dark";
    document.documentElement.dataset.theme = next;
    try {
      localStorage.setItem(KEPT_AS, next);
    } catch { /* as above */ }
    this.read();
  }

  // Every colour as an own property, "ring-error" as ring_error.
  read() {
    const probe = document.createElement("i");
    document.body.append(probe);
    for (const name of NAMES) {
      probe.style.color = `var(--${name})`;
      this[name.replaceAll("-", "_")] = getComputedStyle(probe).color;
    }
    this.font = getComputedStyle(document.body).fontFamily;
    probe.remove();
    this.onChange();
  }
}
