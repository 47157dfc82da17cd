// Pictures of the past, in order of time, as many as memory may hold.

const MOST_ROWS = 500_000; // 24 MB
const BESIDES = 25; // what a picture takes besides its vehicles, in rows of one vehicle
const SAME_S = 1e-4;

const rowsOf = (picture) => picture.count + BESIDES;

export class History {
  #pictures = [];
  #rows = 0;

  get length() { return this.#pictures.length; }
  get first() { return this.#pictures[0]?.t ?? NaN; }
  get last() { return this.#pictures.at(-1)?.t ?? NaN; }

  at(index) { return this.#pictures[index]; }

  // How many vehicles the newest picture holds.
  get crowd() { return this.#pictures.at(-1)?.count ?? 0; }

  clear() {
    this.#pictures = [];
    this.#rows = 0;
  }

  // Index of the last picture at or before t, -1 if there is none.
  before(t) {
    let low = 0, high = this.#pictures.length;
    while (low < high) {
      const middle = (low + high) >> 1;
      if (this.#pictures[middle].t <= t + SAME_S) low = middle + 1;
      else high = middle;
    }
    return low - 1;
  }

  // Take a picture; what is furthest from `near` gives way when there are too many. True if something did.
  add(picture, near) {
    const index = this.before(picture.t);
    const known = this.#pictures[index];
    if (known && Math.abs(known.t - picture.t) <= SAME_S) {
      this.#rows += rowsOf(picture) - rowsOf(known);
      this.#pictures[index] = picture;
    } else {
      this.#rows += rowsOf(picture);
      if (index === this.#pictures.length - 1) this.#pictures.push(picture);
      else this.#pictures.splice(index + 1, 0, picture);
    }
    let dropped = false;
    while (this.#rows > MOST_ROWS && this.#pictures.length > 2) {
      const gone = near - this.first > this.last - near ? this.#pictures.shift() : this.#pictures.pop();
      this.#rows -= rowsOf(gone);
      dropped = true;
    }
    return dropped;
  }

  // Drop what lies in [from, to] and shows another definition.
  purge(from, to, definition) {
    this.#pictures = this.#pictures.filter(
      (each) => each.t < from - SAME_S || each.t > to + SAME_S || each.definition === definition);
    this.#rows = this.#pictures.reduce((sum, each) => sum + rowsOf(each), 0);
  }
}
