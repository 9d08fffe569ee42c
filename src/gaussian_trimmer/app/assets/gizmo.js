// @ts-check
// Handles that move, turn and scale the active object, where files are to have it.
import { add, cross, dot, movedPoint, product, times } from "./canvas.js";
/** @typedef {import("./tools.js").Tools} Tools */
/** @typedef {import("./canvas.js").Vector} Vector */
/** @typedef {import("./canvas.js").Quaternion} Quaternion */
/** @typedef {import("./canvas.js").Similarity} Similarity */
/** @typedef {[number, number]} Place */
/** @typedef {(point: Vector) => {x: number, y: number, depth: number}} OnScreen */

const PLACING = ["Move", "Rotate", "Scale"];
const PIXELS = 90, SEGMENTS = 48; // size of the handles, and lines of a ring
const NUDGED = { pixels: 10, radians: Math.PI / 36, scale: 1.05 };
const RESTING_MILLISECONDS = 300;
const COLOURS = ["x", "y", "z"];

/** Seen with its tools alone. */
export class Gizmo {
  /** @param {Tools} tools */
  constructor(tools) {
    this.tools = tools;
    this.told = "";
    this.waiting = 0;
    /** @type {(Similarity | null)[]} */ this.moved = [];
  }

  get placing() {
    return this.tools.link.state.placing;
  }

  get active() {
    return this.tools.canvas.active - 1;
  }

  /** @returns {Similarity} of the active object */
  get at() {
    return this.moved[this.active] ?? { scale: 1, turn: [1, 0, 0, 0], to: [0, 0, 0] };
  }

  /** What it looks like depends on this. */
  get drawnBy() {
    return [this.tools.tool, this.active, this.at, this.isSeen];
  }

  get isSeen() {
    return this.tools.canvas.palette[4 * this.tools.canvas.active + 3] > 0;
  }

  /** Where the active object's foot is now. */
  get pivot() {
    return movedPoint(this.at, this.placing.foot);
  }

  /** Show objects where they were moved to, with the tools for it. */
  follow() {
    const on = PLACING.includes(this.tools.tool) && this.placing, told = on ? JSON.stringify([this.placing.moved, this.tools.canvas.showing.when]) : "";
    if (told === this.told || this.tools.dragHandle || this.waiting) return;
    this.told = told;
    this.moved = on ? structuredClone(this.placing.moved) : [];
    this.tools.canvas.move(on ? this.moved : null);
  }

  /** @param {Similarity} by */
  use(by) {
    this.moved[this.active] = by;
    this.tools.canvas.move(this.moved, false);
  }

  /** @param {Vector} step */
  shift(step) {
    this.use({ ...this.at, to: add(this.at.to, step) });
  }

  /** Turn around the foot. @param {Vector} axis @param {number} radians */
  turn(axis, radians) {
    const { pivot, at } = this, half = Math.sin(radians / 2);
    const turn = product([Math.cos(radians / 2), axis[0] * half, axis[1] * half, axis[2] * half], at.turn), size = Math.hypot(...turn);
    this.keep(pivot, { ...at, turn: /** @type {Quaternion} */ (turn.map((value) => value / size)) });
  }

  /** Scale from the foot. @param {number} factor */
  grow(factor) {
    this.keep(this.pivot, { ...this.at, scale: Math.min(1000, Math.max(0.001, this.at.scale * factor)) });
  }

  /** @param {Vector} pivot that stays @param {Similarity} by */
  keep(pivot, by) {
    const off = movedPoint(by, this.placing.foot);
    this.use({ ...by, to: add(by.to, add(pivot, times(off, -1))) });
  }

  drop() {
    const object = this.tools.link.state.objects?.[this.active], by = this.moved[this.active];
    this.tools.canvas.move(this.moved);
    if (object && by) this.tools.link.say({ is: "move", object: object.id, by });
  }

  /** Move, turn or scale a little by keys; whether it does. @param {number[]} way */
  nudge([left, up]) {
    const { tool, canvas } = this.tools;
    if (!PLACING.includes(tool) || !this.placing?.foot) return false;
    const { right, down } = canvas.pose(), share = canvas.pixel * canvas.project(this.pivot).depth * NUDGED.pixels;
    if (tool === "Move") this.shift(add(times(right, -left * share), times(down, up * share)));
    else if (tool === "Rotate") this.turn(left ? this.placing.axes[2] : right, (left || up) * NUDGED.radians);
    else this.grow(NUDGED.scale ** -(up || left));
    clearTimeout(this.waiting); // keys in a row are one step
    this.waiting = window.setTimeout(() => ((this.waiting = 0), this.drop()), RESTING_MILLISECONDS);
    return true;
  }

  /** @param {OnScreen} onScreen @param {(a: Vector, b: Vector, kind: string) => void} line */
  draw(onScreen, line) {
    const { tools } = this, { tool, canvas } = tools;
    this.follow();
    if (!PLACING.includes(tool) || !this.placing?.foot || !this.moved || !this.isSeen) return;
    const { pivot } = this, { x, y, depth } = onScreen(pivot), pixel = canvas.pixel * depth, drop = () => this.drop();
    if (depth <= 0) return;
    const put = (/** @type {string} */ name, /** @type {Record<string, any>} */ facts, /** @type {string} */ kind, /** @type {(at: Place, from: Place) => void} */ drag) =>
      tools.handle(tools.shape(name, { ...facts, class: `gizmo handle ${kind}` }, tools.space), drag, drop);
    if (tool === "Move") {
      this.placing.axes.forEach((/** @type {Vector} */ axis, /** @type {number} */ i) => {
        const tip = add(pivot, times(axis, PIXELS * pixel)), end = onScreen(tip), way = [end.x - x, end.y - y], length = way[0] ** 2 + way[1] ** 2;
        line(pivot, tip, `gizmo ${COLOURS[i]}`);
        if (length > 100) // otherwise it points at the eye
          put("circle", { cx: end.x, cy: end.y, r: 8 }, COLOURS[i], (at, from) =>
            this.shift(times(axis, (PIXELS * pixel * ((at[0] - from[0]) * way[0] + (at[1] - from[1]) * way[1])) / length)));
      });
      const { right, down } = canvas.pose();
      put("rect", { x: x - 8, y: y - 8, width: 16, height: 16 }, "", (at, from) => this.shift(add(times(right, (at[0] - from[0]) * pixel), times(down, (at[1] - from[1]) * pixel))));
    } else if (tool === "Rotate")
      this.placing.axes.forEach((/** @type {Vector} */ axis, /** @type {number} */ i, /** @type {Vector[]} */ axes) => {
        const [a, b] = [axes[(i + 1) % 3], axes[(i + 2) % 3]], facing = dot(cross(a, b), axis) * dot(axis, canvas.pose().forward) > 0 ? 1 : -1;
        const ring = Array.from({ length: SEGMENTS + 1 }, (_, k) => {
          const angle = (2 * Math.PI * k) / SEGMENTS, at = onScreen(add(pivot, times(add(times(a, Math.cos(angle)), times(b, Math.sin(angle))), PIXELS * pixel)));
          return `${at.x},${at.y}`;
        });
        const angleOf = (/** @type {Place} */ at) => Math.atan2(at[1] - y, at[0] - x);
        put("polyline", { points: ring.join(" ") }, COLOURS[i], (at, from) => {
          const turned = angleOf(at) - angleOf(from);
          this.turn(axis, facing * Math.atan2(Math.sin(turned), Math.cos(turned)));
        });
      });
    else {
      const corner = add(pivot, times(add(canvas.pose().right, times(canvas.pose().down, -1)), PIXELS * pixel)), end = onScreen(corner);
      line(pivot, corner, "gizmo");
      const away = (/** @type {Place} */ at) => Math.max(4, Math.hypot(at[0] - x, at[1] - y));
      put("circle", { cx: end.x, cy: end.y, r: 9 }, "", (at, from) => this.grow(away(at) / away(from)));
    }
  }
}
