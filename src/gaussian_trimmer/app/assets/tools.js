// @ts-check
// What hands do in the 3D view: turning, moving and flying, and the tools, with what is drawn over the picture.
import { Paint } from "./paint.js";
import { Gizmo } from "./gizmo.js";
import { add, dot, times } from "./canvas.js";
/** @typedef {import("./canvas.js").Canvas} Canvas */
/** @typedef {import("./link.js").Link} Link */
/** @typedef {[number, number]} Place */
/** @typedef {import("./canvas.js").Vector} Vector */

const BRUSHES = ["Brush", "Sphere"], DRAWN = ["Box", "Lasso", "Polygon", ...BRUSHES], CLICKED = ["Click", "Colour", "Up by 3 points"];
const FREE_PIXELS = 12; // a press that moves less is a click
const CLOSE_PIXELS = 12; // so near its first corner, a polygon closes
const TWICE_MILLISECONDS = 400; // a second click at the same place within this time is the first one again
const MOST_PLACES = 200;
const FLY = { w: [0, 0, 1], s: [0, 0, -1], a: [-1, 0, 0], d: [1, 0, 0], e: [0, -1, 0], q: [0, 1, 0] }, FLY_SHARE = 0.6;
const TURNS = { ArrowLeft: [1, 0], ArrowRight: [-1, 0], ArrowUp: [0, -1], ArrowDown: [0, 1] };
const RADIANS_A_PIXEL = 0.006;
// Beside the pointer: whether what is marked is added, removed or kept.
const SIGNS = /** @type {Record<string, string>} */ ({ add: "+", remove: "\u2212", intersect: "\u2229" });
const SVG = "http://www.w3.org/2000/svg";
const apart = (/** @type {Place} */ a, /** @type {Place} */ b) => Math.hypot(a[0] - b[0], a[1] - b[1]);
const effectOf = (/** @type {MouseEvent | KeyboardEvent} */ { ctrlKey, metaKey, shiftKey }) =>
  ctrlKey || metaKey ? (shiftKey ? "intersect" : "remove") : shiftKey ? "add" : "";

/** Listens to the canvas and the keyboard. */
export class Tools {
  /** @param {Canvas} canvas @param {Link} link @param {() => void} changed called when something is seen that the program need not know */
  constructor(canvas, link, changed) {
    (this.canvas = canvas), (this.link = link), (this.changed = changed);
    this.paint = new Paint(canvas);
    /** @type {Place[]} */ this.drawn = []; // places in the window
    this.active = ""; // the tool whose drag is going on, or "Polygon" while it has corners
    /** @type {Map<number, PointerEvent>} */ this.pointers = new Map();
    this.moved = 0;
    this.last = { time: 0, at: /** @type {Place} */ ([0, 0]) };
    this.ghost = this.comparing = false;
    this.spaceDrawn = "";
    this.dropHandle = () => {};
    /** @type {any} */ this.box = undefined;
    /** @type {((at: Place) => void) | undefined} */ this.dragHandle = undefined;
    /** @type {Map<string, number[]>} */ this.flying = new Map();
    this.overlay = canvas.element.parentElement?.appendChild(document.createElementNS(SVG, "svg")) ?? document.createElementNS(SVG, "svg");
    this.overlay.id = "gesture-overlay";
    this.space = this.shape("g", {});
    this.gizmo = new Gizmo(this);
    this.swath = this.shape("polyline", { class: "swath" });
    this.outline = this.shape("polygon", { class: "outline" });
    this.ring = this.shape("circle", { class: "ring" });
    this.sign = this.shape("text", { class: "sign" });
    const { element } = canvas;
    element.addEventListener("pointerdown", (event) => this.down(event));
    window.addEventListener("pointermove", (event) => this.move(event));
    for (const end of ["pointerup", "pointercancel"]) window.addEventListener(end, (event) => this.release(/** @type {PointerEvent} */ (event)));
    element.addEventListener("contextmenu", (event) => event.preventDefault());
    element.addEventListener("pointerleave", () => this.draw(null));
    element.addEventListener("wheel", (event) => (event.preventDefault(), canvas.zoom(Math.exp(event.deltaY * (event.deltaMode ? 0.05 : 0.0015)))), { passive: false });
    window.addEventListener("keydown", (event) => this.key(event));
    window.addEventListener("keyup", (event) => this.letGo(event.code, event.key));
    window.addEventListener("blur", () => (this.letGo("Space", "Shift"), this.flying.clear()));
    canvas.followers.push(() => this.drawSpace());
    link.settled = () => this.active || this.paint.end();
  }

  /** @param {string} name @param {Record<string, any>} attributes @param {Element} parent */
  shape(name, attributes, parent = this.overlay) {
    const element = parent.appendChild(document.createElementNS(SVG, name));
    for (const [key, value] of Object.entries(attributes)) element.setAttribute(key, value);
    return element;
  }

  get tool() {
    return this.link.controls.Tool?.value ?? "Look";
  }

  /** What keys or else the mode say that a mark does. @param {MouseEvent | KeyboardEvent} event @returns {string} */
  effect(event) {
    const mode = this.link.controls.Mode;
    return effectOf(event) || (mode?.effects ?? {})[mode?.value];
  }

  get radius() {
    return this.link.controls["Brush radius"]?.value ?? 0;
  }

  /** @param {Place} at @returns {Place} pixels of the canvas */
  inCanvas([x, y]) {
    const { left, top } = this.canvas.element.getBoundingClientRect();
    return [x - left, y - top];
  }

  /** Tell the program what was drawn. @param {string} tool @param {Place[]} places @param {MouseEvent | KeyboardEvent} event */
  sayDrawn(tool, places, event) {
    const { width, height } = this.canvas.element.getBoundingClientRect(), step = Math.max(1, Math.ceil(places.length / MOST_PLACES));
    const chosen = places.filter((_, i) => i % step === 0 || i === places.length - 1).map((place) => this.inCanvas(place));
    const shares = chosen.map(([x, y]) => [Number((x / width).toFixed(5)), Number((y / height).toFixed(5))]);
    const { canvas, link, paint } = this, found = paint.under.filter((row) => row < canvas.total);
    const byRows = paint.under.length > 0 && canvas.count === link.scene.count && (tool === "Sphere" || link.controls["Take by"].value === "Centres");
    link.say({ is: "gesture", tool, places: shares, effect: effectOf(event) || null, ghost: this.ghost }, byRows ? link.bits(found) : undefined);
    paint.settle();
  }

  /** Show what a stroke takes. @param {MouseEvent | KeyboardEvent} event */
  preview(event) {
    const places = this.drawn.map((place) => this.inCanvas(place)), { tool, paint } = this;
    if (BRUSHES.includes(tool)) return paint.dab(places.at(-2) ?? places[0], /** @type {Place} */ (places.at(-1)));
    if (places.length > 1) paint.surround(tool === "Box" ? boxOf(places) : places);
  }

  /** @param {MouseEvent | KeyboardEvent} event */
  beginPaint(event) {
    const { controls, state } = this.link, locked = new Set();
    (state.objects ?? []).forEach((/** @type {any} */ each, /** @type {number} */ i) => (each.locked || each.hidden) && locked.add(i + 1));
    const effect = this.effect(event);
    this.paint.begin({ effect, through: controls.Reach.value === "Through", locked, tool: this.tool, radius: this.radius });
  }

  /** @param {PointerEvent} event */
  down(event) {
    const { tool, canvas } = this, at = /** @type {Place} */ ([event.clientX, event.clientY]);
    /** @type {HTMLElement} */ (document.activeElement)?.blur();
    canvas.element.setPointerCapture(event.pointerId);
    this.pointers.set(event.pointerId, event);
    this.moved = 0;
    this.pressed = at;
    if (this.pointers.size > 1) return this.giveUp();
    if (event.button !== 0 || event.altKey || !DRAWN.includes(tool)) return;
    event.preventDefault();
    if (tool === "Polygon") {
      if (this.active && this.drawn.length > 2 && apart(at, this.drawn[0]) < CLOSE_PIXELS) return this.finish(event);
      if (!this.drawn.length || apart(at, this.drawn[this.drawn.length - 1]) > 2) this.drawn.push(at);
      if (!this.active) this.beginPaint(event);
    } else (this.drawn = tool === "Box" ? [at, at] : [at]), this.beginPaint(event);
    this.active = tool;
    this.preview(event);
    this.draw(at);
  }

  /** @param {PointerEvent} event */
  move(event) {
    const { tool, canvas } = this, at = /** @type {Place} */ ([event.clientX, event.clientY]), before = this.pointers.get(event.pointerId);
    if (this.dragHandle) return this.dragHandle(at);
    if (before && this.pressed) this.moved = Math.max(this.moved, apart(at, this.pressed));
    if (this.active && this.active !== tool) this.giveUp();
    if (this.active && this.active !== "Polygon" && before) {
      if (tool === "Box") this.drawn[1] = at;
      else if (apart(at, this.drawn[this.drawn.length - 1]) > 1.5) this.drawn.push(at);
      this.preview(event);
    } else if (before && !(this.active && !event.altKey && event.buttons & 1)) this.steer(event, before);
    if (before) this.pointers.set(event.pointerId, event);
    const over = event.target === canvas.element || this.active;
    this.draw(over ? at : null);
    if (tool === "Look" || !over || event.altKey) return;
    this.sign.textContent = SIGNS[this.effect(event)] ?? "";
    this.sign.setAttribute("x", String(at[0] + 14)), this.sign.setAttribute("y", String(at[1] - 10));
  }

  /** Turn, move or zoom the view. @param {PointerEvent} event @param {PointerEvent} before */
  steer(event, before) {
    const { canvas } = this, x = event.clientX - before.clientX, y = event.clientY - before.clientY;
    const share = canvas.pixel;
    const other = [...this.pointers.values()].find((each) => each.pointerId !== event.pointerId);
    if (other) {
      const away = (/** @type {PointerEvent} */ one) => apart([one.clientX, one.clientY], [other.clientX, other.clientY]) || 1;
      canvas.zoom(away(before) / away(event));
      canvas.pan((-x / 2) * share, (-y / 2) * share);
    } else if (event.buttons & 6) canvas.pan(-x * share, -y * share);
    else if (CLICKED.includes(this.tool) && this.moved < FREE_PIXELS) return;
    else canvas.orbit(-x * RADIANS_A_PIXEL, y * RADIANS_A_PIXEL);
  }

  /** @param {PointerEvent} event */
  release(event) {
    if (this.dragHandle) (this.dragHandle = undefined), this.dropHandle();
    if (!this.pointers.delete(event.pointerId)) return;
    const { tool } = this, at = /** @type {Place} */ ([event.clientX, event.clientY]), still = this.moved < FREE_PIXELS && !event.altKey;
    if (event.type === "pointercancel") return this.giveUp();
    if (this.active && this.active !== "Polygon") {
      if (still && !BRUSHES.includes(tool)) return this.giveUp(); // neither a box nor a lasso
      return this.finish(event);
    }
    if (!still || event.button !== 0 || !CLICKED.includes(tool) || this.pointers.size) return;
    const again = event.timeStamp - this.last.time < TWICE_MILLISECONDS && apart(at, this.last.at) < FREE_PIXELS;
    this.last = { time: event.timeStamp, at };
    if (!again) this.sayDrawn(tool, [at], event);
  }

  /** @param {MouseEvent | KeyboardEvent} event */
  finish(event) {
    if (this.active && this.drawn.length) this.sayDrawn(this.active, this.drawn, event);
    (this.drawn = []), (this.active = "");
    this.draw(null);
  }

  giveUp() {
    (this.drawn = []), (this.active = "");
    this.paint.end();
    this.draw(null);
  }

  /** @param {KeyboardEvent} event */
  key(event) {
    const target = /** @type {HTMLElement} */ (event.target);
    if (target.matches?.('input:not([type="checkbox"]):not([readonly]), textarea, select')) {
      if (event.key === "Escape" || (event.key === "Enter" && target.matches("input"))) target.blur();
      return;
    }
    if (event.key === "Enter" && target.matches?.("button, summary, [tabindex]") && !this.active) return;
    if (event.key === "Tab") return;
    if (this.active && event.key === "Escape") return this.giveUp();
    if (this.active === "Polygon" && event.key === "Backspace") return this.drawn.pop(), this.draw(null);
    if (this.active === "Polygon" && event.key === "Enter" && this.drawn.length > 2) return this.finish(event);
    if (event.key === "Shift") return this.hold("ghost", true);
    if (event.code === "Space") return event.preventDefault(), event.repeat || this.hold("comparing", true);
    if (event.key in TURNS && this.gizmo.nudge(TURNS[/** @type {keyof typeof TURNS} */ (event.key)])) return event.preventDefault();
    if (!event.ctrlKey && !event.metaKey && !event.altKey && this.fly(event)) return event.preventDefault();
    const name = this.bound(event);
    if (!name) return;
    event.preventDefault();
    if (name in LOCAL) return LOCAL[/** @type {keyof typeof LOCAL} */ (name)](this.link);
    this.link.say({ is: "do", action: name });
  }

  /** @param {"ghost" | "comparing"} what @param {boolean} on */
  hold(what, on) {
    if (this[what] === on) return;
    this[what] = on;
    this.changed();
  }

  /** @param {string} code @param {string} key */
  letGo(code, key) {
    if (key === "Shift") this.hold("ghost", false);
    if (code === "Space") this.hold("comparing", false);
    this.flying.delete(code);
  }

  /** Fly with W A S D Q E, turn with arrows. @param {KeyboardEvent} event */
  fly(event) {
    const turns = TURNS[/** @type {keyof typeof TURNS} */ (event.key)], way = FLY[/** @type {keyof typeof FLY} */ (event.key.toLowerCase())];
    if (turns) this.canvas.turn(0.05 * turns[0], 0.05 * turns[1]);
    if (way && !event.repeat) {
      if (!this.flying.size) this.glide(performance.now());
      this.flying.set(event.code, way.map((each) => each * (event.shiftKey ? 4 : 1)));
    }
    return Boolean(turns || way);
  }

  /** @param {number} before */
  glide(before) {
    requestAnimationFrame((now) => {
      if (!this.flying.size) return;
      const seconds = Math.min(0.1, (now - before) / 1000);
      for (const [x, y, z] of this.flying.values()) this.canvas.pan(x * FLY_SHARE * seconds, y * FLY_SHARE * seconds, z * FLY_SHARE * seconds);
      this.glide(now);
    });
  }

  /** The action that a key is bound to. @param {KeyboardEvent} event */
  bound(event) {
    const names = /** @type {Record<string, string>} */ ({ Escape: "Esc" });
    const held = [(event.ctrlKey || event.metaKey) && "Ctrl", event.shiftKey && /^.$/.test(event.key) && "Shift"].filter(Boolean);
    const key = [...held, names[event.key] ?? (event.key.length === 1 ? event.key.toUpperCase() : event.key)].join("+");
    if (event.altKey) return undefined;
    return Object.entries(this.link.state.keys ?? {}).find(([, keys]) => String(keys).split(", ").includes(key))?.[0];
  }

  /** What the tool draws over the picture. @param {Place | null} at */
  draw(at) {
    const { tool, drawn, radius } = this, brush = BRUSHES.includes(tool);
    this.sign.textContent = "";
    const corners = tool === "Box" && this.active ? boxOf(drawn) : this.active === "Polygon" && at ? [...drawn, at] : drawn;
    const text = corners.map((place) => place.join(",")).join(" ");
    this.outline.setAttribute("points", brush ? "" : text);
    this.swath.setAttribute("points", brush ? text : "");
    this.swath.setAttribute("stroke-width", String(2 * radius));
    this.ring.setAttribute("r", String(brush && at ? radius : 0));
    if (at) this.ring.setAttribute("cx", String(at[0])), this.ring.setAttribute("cy", String(at[1]));
  }

  /** What stands in the scene: the box with its handles, virtual cameras, points that were clicked. */
  drawSpace() {
    const { box, frusta, points, placing } = this.link.state;
    if (!this.dragHandle && JSON.stringify(box) !== this.boxTold) (this.boxTold = JSON.stringify(box)), (this.box = box && structuredClone(box));
    const pose = this.canvas.pose(), key = JSON.stringify([pose, this.box, frusta, points, placing, this.gizmo.drawnBy, innerWidth, innerHeight]);
    if (key === this.spaceDrawn) return;
    this.spaceDrawn = key;
    this.space.replaceChildren();
    const onScreen = (/** @type {Vector} */ point) => this.canvas.project(point, pose);
    const line = (/** @type {Vector} */ a, /** @type {Vector} */ b, /** @type {string} */ kind) => {
      const [from, to] = [onScreen(a), onScreen(b)];
      if (from.depth > 0 && to.depth > 0) this.shape("line", { x1: from.x, y1: from.y, x2: to.x, y2: to.y, class: kind }, this.space);
    };
    for (const [number, { places, rejected }] of (frusta ?? []).entries()) {
      const kind = `frustum${rejected ? " rejected" : ""}`, [eye, ...corners] = places;
      corners.forEach((/** @type {Vector} */ corner, /** @type {number} */ i) => (line(eye, corner, kind), line(corner, corners[(i + 1) % 4], kind)));
      const { x, y, depth } = onScreen(eye);
      if (depth <= 0) continue;
      const dot = this.shape("circle", { cx: x, cy: y, r: 6, class: `${kind} handle` }, this.space);
      dot.addEventListener("pointerenter", () => this.showPicture(number, rejected));
      dot.addEventListener("pointerleave", () => this.picture?.remove());
    }
    for (const point of points ?? []) {
      const { x, y, depth } = onScreen(point);
      if (depth > 0) this.shape("circle", { cx: x, cy: y, r: 5, class: "point" }, this.space);
    }
    if (this.box) this.drawBox(onScreen, line);
    this.gizmo.draw(onScreen, line);
  }

  /** @param {number} number @param {string} rejected */
  showPicture(number, rejected) {
    this.picture?.remove();
    this.picture = Object.assign(document.createElement("figure"), { className: "gt-view" });
    this.picture.append(Object.assign(document.createElement("img"), { src: `view/${number}`, alt: "" }), rejected ? `Rejected: ${rejected}` : "");
    document.body.append(this.picture);
  }

  /** @param {number[]} ends corner in the box's axes @returns {Vector} */
  boxPoint(ends) {
    const { axes } = this.box;
    return add(add(times(axes[0], ends[0]), times(axes[1], ends[1])), times(axes[2], ends[2]));
  }

  /** @param {(point: Vector) => {x: number, y: number, depth: number}} onScreen @param {(a: Vector, b: Vector, kind: string) => void} line */
  drawBox(onScreen, line) {
    const { low, high } = this.box, corner = (/** @type {number} */ i) => this.boxPoint([0, 1, 2].map((axis) => ((i >> axis) & 1 ? high : low)[axis]));
    for (let i = 0; i < 8; i++) for (const bit of [1, 2, 4]) if (!(i & bit)) line(corner(i), corner(i | bit), "box");
    const middle = low.map((/** @type {number} */ value, /** @type {number} */ axis) => (value + high[axis]) / 2);
    const handle = (/** @type {number[]} */ ends, /** @type {string} */ name, /** @type {Record<string, any>} */ facts, /** @type {(at: Place, from: Place) => void} */ drag) => {
      const { x, y, depth } = onScreen(this.boxPoint(ends));
      if (depth <= 0) return;
      const element = this.shape(name, facts.r ? { ...facts, cx: x, cy: y, class: "box handle" } : { ...facts, x: x - 8, y: y - 8, class: "box handle" }, this.space);
      this.handle(element, drag, () => this.sayBox());
    };
    for (let face = 0; face < 6; face++) {
      const axis = face >> 1, end = face & 1 ? high : low, other = face & 1 ? low : high, place = middle.slice();
      place[axis] = end[axis];
      handle(place, "circle", { r: 7 }, (at, from) => {
        const here = middleOf(low, high, axis, end[axis]), there = here.slice();
        there[axis] += 1e-3 * (high[axis] - low[axis] || 1);
        const [a, b] = [this.canvas.project(this.boxPoint(here)), this.canvas.project(this.boxPoint(there))], way = [b.x - a.x, b.y - a.y];
        const along = ((at[0] - from[0]) * way[0] + (at[1] - from[1]) * way[1]) / Math.max(1e-12, way[0] ** 2 + way[1] ** 2);
        const moved = end[axis] + along * (there[axis] - here[axis]), least = 1e-3 * (face & 1 ? 1 : -1);
        end[axis] = face & 1 ? Math.max(moved, other[axis] + least) : Math.min(moved, other[axis] + least);
      });
    }
    handle(middle, "rect", { width: 16, height: 16 }, (at, from) => {
      const pose = this.canvas.pose(), { depth } = this.canvas.project(this.boxPoint(middleOf(low, high)), pose);
      const share = depth * this.canvas.pixel;
      const step = add(times(pose.right, (at[0] - from[0]) * share), times(pose.down, (at[1] - from[1]) * share));
      for (let axis = 0; axis < 3; axis++) (low[axis] += dot(step, this.box.axes[axis])), (high[axis] += dot(step, this.box.axes[axis]));
    });
  }

  /** Something that can be dragged. @param {Element} element @param {(at: Place, from: Place) => void} drag @param {() => void} drop */
  handle(element, drag, drop) {
    element.addEventListener("pointerdown", (event) => {
      event.preventDefault();
      const start = /** @type {PointerEvent} */ (event);
      let from = /** @type {Place} */ ([start.clientX, start.clientY]);
      this.dragHandle = (at) => (drag(at, from), (from = at), this.canvas.refresh());
      this.dropHandle = drop;
    });
  }

  sayBox() {
    this.link.say({ is: "drag", low: this.box.low, high: this.box.high });
  }
}

// What the page does by itself and tells the program afterwards.
const next = (/** @type {string} */ name) => (/** @type {Link} */ link) => {
  const { value, options = [] } = link.controls[name];
  link.enter(name, options[(options.indexOf(value) + 1) % options.length]);
};
const LOCAL = { "Own colours, objects, changes": next("Colours"), "Footprint or centres": next("Take by"), "Surface or through": next("Reach") };

/** @param {Place[]} places @returns {Place[]} */
const boxOf = ([[x0, y0], [x1, y1]]) => [[x0, y0], [x1, y0], [x1, y1], [x0, y1]];

/** @param {number[]} low @param {number[]} high @param {number=} axis @param {number=} at */
function middleOf(low, high, axis, at) {
  return low.map((value, i) => (i === axis && at !== undefined ? at : (value + high[i]) / 2));
}
