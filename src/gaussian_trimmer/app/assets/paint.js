// @ts-check
// Strokes, live: which splats lie under a brush, an outline or a sphere, found here while the pointer moves.
import { AFTER, BEFORE, LIVE } from "./canvas.js";
/** @typedef {import("./canvas.js").Canvas} Canvas */
/** @typedef {[number, number]} Place */

const UNCHANGED = 3; // of the byte that shows what a stroke does
const CELL = 16, STEP = 4; // pixels of a cell in which splats are looked up, and of the picture of depths

/** What is under strokes in the view as it is. */
export class Paint {
  /** @param {Canvas} canvas */
  constructor(canvas) {
    this.canvas = canvas;
    /** @type {number[]} */ this.touched = []; // by strokes that the program has not answered
    /** @type {number[]} */ this.under = []; // by this stroke
    this.key = "";
    this.reach = this.plane = 0;
  }

  /** Find where all splats show, unless that is known. */
  prepare() {
    const { canvas } = this, { clientWidth: width, clientHeight: height } = canvas.element;
    const pose = canvas.pose(), key = JSON.stringify([pose, width, height, canvas.shownVersion, canvas.showing, canvas.count]);
    if (key === this.key) return;
    this.key = key;
    const { right, down, forward, eye } = pose, focal = pose.focal * height, numbers = new Float32Array(canvas.texels.buffer);
    this.columns = Math.ceil(width / CELL) + 1;
    const starts = (this.starts = new Uint32Array(this.columns * (Math.ceil(height / CELL) + 1) + 1));
    const cells = starts.length - 1, n = canvas.total + canvas.extras;
    const cellOf = new Int32Array(n).fill(-1);
    const xs = (this.xs = new Float32Array(n)), ys = (this.ys = new Float32Array(n)), depths = (this.depths = new Float32Array(n));
    for (const [first, last] of canvas.allRanges())
      for (let i = first; i < last; i++) {
        const x = numbers[8 * i] - eye[0], y = numbers[8 * i + 1] - eye[1], z = numbers[8 * i + 2] - eye[2];
        const depth = x * forward[0] + y * forward[1] + z * forward[2];
        if (depth < canvas.near) continue;
        const across = width / 2 + (focal / depth) * (x * right[0] + y * right[1] + z * right[2]);
        const below = height / 2 + (focal / depth) * (x * down[0] + y * down[1] + z * down[2]);
        if (!(across >= 0 && across < width && below >= 0 && below < height) || !canvas.isShown(i)) continue;
        (xs[i] = across), (ys[i] = below), (depths[i] = depth);
        cellOf[i] = Math.floor(below / CELL) * this.columns + Math.floor(across / CELL);
        starts[cellOf[i] + 1]++;
      }
    for (let i = 0; i < cells; i++) starts[i + 1] += starts[i];
    const next = starts.slice(), members = (this.members = new Uint32Array(starts[cells]));
    for (let i = 0; i < n; i++) if (cellOf[i] >= 0) members[next[cellOf[i]]++] = i;
    this.surface = canvas.surface(STEP);
  }

  /** Begin a stroke. @param {{effect: string, through: boolean, locked: Set<number>, tool: string, radius: number}} how */
  begin(how) {
    this.prepare();
    this.settle();
    this.how = how;
    this.plane = this.canvas.showing.when ? AFTER : BEFORE;
    this.reach = how.radius * this.canvas.pixel;
  }

  /** Call `act` with the splats in cells that a rectangle meets. @param {number[]} box left, top, right, bottom @param {(i: number) => void} act */
  within([left, top, right, bottom], act) {
    const { columns = 1, starts, members } = this;
    if (!starts || !members) return;
    const rows = (starts.length - 1) / columns;
    for (let row = Math.max(0, Math.floor(top / CELL)); row <= Math.min(rows - 1, Math.floor(bottom / CELL)); row++) {
      const first = row * columns + Math.max(0, Math.floor(left / CELL)), last = row * columns + Math.min(columns - 1, Math.floor(right / CELL));
      if (first <= last) for (let k = starts[first]; k < starts[last + 1]; k++) act(members[k]);
    }
  }

  /** Whether a splat is on the surface, or as deep below it as the tool reaches. @param {number} i */
  reaches(i) {
    const { surface, xs, ys, depths } = this;
    if (!surface || !xs || !ys || !depths) return false;
    const depth = surface.depths[Math.floor(ys[i] / STEP) * surface.width + Math.floor(xs[i] / STEP)];
    return !(depths[i] > depth * (1 + this.reach));
  }

  /** A splat is meant; show it if a mark can change it. @param {number} i */
  mean(i) {
    const { canvas, how } = this;
    if (!how || canvas.states[4 * i + LIVE]) return;
    const owner = canvas.states[4 * i + this.plane], ours = owner === canvas.active;
    const changes = how.effect === "remove" ? ours : how.effect === "add" && !ours && !how.locked.has(owner);
    canvas.set(i, LIVE, !changes ? UNCHANGED : how.effect === "remove" ? 2 : 1);
    this.under.push(i);
  }

  /** The brush has moved. @param {Place} from @param {Place} to pixels of the canvas */
  dab([x0, y0], [x1, y1]) {
    const radius = this.how?.radius ?? 0, [dx, dy] = [x1 - x0, y1 - y0], length = dx * dx + dy * dy || 1;
    this.within([Math.min(x0, x1) - radius, Math.min(y0, y1) - radius, Math.max(x0, x1) + radius, Math.max(y0, y1) + radius], (i) => {
      const [x, y] = [this.xs?.[i] ?? 0, this.ys?.[i] ?? 0], along = Math.max(0, Math.min(1, ((x - x0) * dx + (y - y0) * dy) / length));
      if (Math.hypot(x - x0 - along * dx, y - y0 - along * dy) <= radius && (this.how?.through || this.reaches(i))) this.mean(i);
    });
    this.canvas.refresh();
  }

  /** The outline is another one. @param {Place[]} corners */
  surround(corners) {
    for (const i of this.under) this.canvas.set(i, LIVE, 0);
    this.under = [];
    const xs = corners.map(([x]) => x), ys = corners.map(([, y]) => y);
    const box = [Math.min(...xs), Math.min(...ys), Math.max(...xs), Math.max(...ys)];
    const width = Math.max(1, Math.ceil(box[2] - box[0])), height = Math.max(1, Math.ceil(box[3] - box[1]));
    if (width * height < 4 || width > 8192 || height > 8192) return;
    const context = /** @type {OffscreenCanvasRenderingContext2D} */ (new OffscreenCanvas(width, height).getContext("2d", { willReadFrequently: true }));
    context.beginPath();
    for (const [x, y] of corners) context.lineTo(x - box[0], y - box[1]);
    context.fill("evenodd");
    const inside = context.getImageData(0, 0, width, height).data;
    this.reach = Math.sqrt(inside.reduce((sum, value, i) => sum + (i % 4 === 3 && value > 127 ? 1 : 0), 0) / Math.PI) * this.canvas.pixel;
    this.within(box, (i) => {
      const x = Math.floor((this.xs?.[i] ?? 0) - box[0]), y = Math.floor((this.ys?.[i] ?? 0) - box[1]);
      if (x >= 0 && y >= 0 && x < width && y < height && inside[4 * (y * width + x) + 3] > 127 && (this.how?.through || this.reaches(i))) this.mean(i);
    });
    this.canvas.refresh();
  }

  /** The stroke is done: its tint stays until the program has answered. */
  settle() {
    for (const i of this.under) this.touched.push(i);
    this.under = [];
  }

  /** Forget what was meant. */
  end() {
    this.settle();
    for (const i of this.touched) this.canvas.set(i, LIVE, 0);
    this.touched = [];
    this.canvas.refresh();
  }
}
