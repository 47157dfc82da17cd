// One instant as the server tells it, packed: numbers in one array, names shared with the instant before.

export const N = 0, E = 1, VN = 2, VE = 3, AIRFRAME = 4, ERROR = 5, DISPLACEMENT = 6, AGE = 7, ALTITUDE = 8;
export const TRUE_N = 9, TRUE_E = 10, STATUS = 11, FIELDS = 12;
export const FLYING = 0, STRANGER = 1, STALE = 2;

const number = (value) => (typeof value === "number" ? value : NaN);

let lastNames = [];

function shared(names) {
  const same = names.length === lastNames.length && names.every((name, i) => name === lastNames[i]);
  if (!same) lastNames = names;
  return lastNames;
}

// {t, definition, count, names, values (count x FIELDS), pairs (k x 5: i, j, distance, required, entry), tightest (i, j, distance, required), selected, fastest}
export function pack(instant, definition) {
  const rows = instant.vehicles ?? [];
  const values = new Float32Array(rows.length * FIELDS);
  rows.forEach((row, i) => {
    for (let field = 0; field < FIELDS; field += 1) values[i * FIELDS + field] = number(row[field + 1]);
  });
  const pairs = new Float32Array((instant.pairs?.length ?? 0) * 5);
  instant.pairs?.forEach((pair, i) => {
    for (let field = 0; field < 5; field += 1) pairs[i * 5 + field] = number(pair[field]);
  });
  let fastest = 0;
  for (let at = 0; at < values.length; at += FIELDS) fastest = Math.max(fastest, Math.hypot(values[at + VN], values[at + VE]) || 0);
  return {
    t: instant.t,
    definition: instant.definition ?? definition,
    count: rows.length,
    names: shared(rows.map((row) => String(row[0]))),
    values,
    pairs,
    tightest: instant.tightest ?? null,
    selected: instant.selected ?? null,
    fastest,
    following: null,
  };
}

const indices = new WeakMap();

// Where a name stands in a picture, -1 if nowhere.
export function indexOf(picture, name) {
  let index = indices.get(picture.names);
  if (!index) {
    index = new Map(picture.names.map((each, i) => [each, i]));
    indices.set(picture.names, index);
  }
  return index.get(name) ?? -1;
}

// For every vehicle of a picture, where it stands in a later one; computed once for two pictures in a row.
export function links(picture, later) {
  if (picture.following?.later !== later) {
    const index = picture.names === later.names
      ? Int16Array.from(picture.names.keys())
      : Int16Array.from(picture.names, (name) => indexOf(later, name));
    picture.following = { later, index };
  }
  return picture.following.index;
}
