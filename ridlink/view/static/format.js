// Numbers and names as people read them.

export const UNKNOWN = "–";

export function metres(value) {
  if (!Number.isFinite(value)) return UNKNOWN;
  return `${Math.abs(value) < 99.95 ? value.toFixed(1) : value.toFixed(0)} m`;
}

export function signedMetres(value) {
  if (!Number.isFinite(value)) return UNKNOWN;
  const size = metres(Math.abs(value));
  return value < 0 ? `−${size}` : `+${size}`;
}

export function fixed(value, digits) {
  return Number.isFinite(value) ? value.toFixed(digits) : UNKNOWN;
}

// 75.3 -> "1:15.3", 3675 -> "1:01:15.0"
export function clockTime(seconds, digits = 1) {
  if (!Number.isFinite(seconds)) return UNKNOWN;
  const scale = 10 ** digits, ticks = Math.round(Math.abs(seconds) * scale);
  const whole = Math.floor(ticks / scale), hours = Math.floor(whole / 3600);
  const minutes = Math.floor(whole / 60) % 60, rest = whole % 60;
  const fraction = digits ? `.${String(ticks % scale).padStart(digits, "0")}` : "";
  const two = (value) => String(value).padStart(2, "0");
  const text = hours ? `${hours}:${two(minutes)}:${two(rest)}` : `${minutes}:${two(rest)}`;
  return `${seconds < 0 && ticks ? "−" : ""}${text}${fraction}`;
}

export function utcTime(utcSeconds) {
  if (!Number.isFinite(utcSeconds)) return "";
  const date = new Date(utcSeconds * 1000);
  return Number.isNaN(date.getTime()) ? "" : `${date.toISOString().slice(0, 19).replace("T", " ")} UTC`;
}

// Names come from strangers: one line, no control characters, not longer than there is room for.
export function label(name, longest = 16) {
  const clean = name.replace(/[\u0000-\u001f\u007f-\u009f\u2028-\u202e\u2066-\u2069]/g, "·");
  return clean.length <= longest ? clean : `${clean.slice(0, longest - 6)}…${clean.slice(-5)}`;
}

// Names with numbers in them by number.
export function inOrder(names) {
  return [...names].sort(collator.compare);
}

const collator = new Intl.Collator("en", { numeric: true });

// A pair, in the same order wherever it stands.
export function pairLabel(names, longest) {
  return inOrder(names).map((name) => label(name, longest)).join(" · ");
}

// How near a pair is, by what is left between its discs: "inside", "near" or "clear".
export function nearness(distance, required) {
  if (distance < required) return "inside";
  return distance - required < 0.5 * required ? "near" : "clear";
}

export const KIND = { inside: "alarm", near: "warn", clear: "" };
