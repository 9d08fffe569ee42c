// @ts-check
// What the page has of the program: its state, of which it is told changes, and the scene's splats; and what it tells it.
import { AFTER, BEFORE, FLAGS } from "./canvas.js";
/** @typedef {import("./canvas.js").Canvas} Canvas */
/** @typedef {{value: any, options?: string[], limits?: number[], effects?: Record<string, string>}} Control */

const PORTIONS = 16, RETRY_MILLISECONDS = 1000, LOST_MILLISECONDS = 3000, WORDS = 8;

/** @param {Uint8Array} data @param {CompressionStream | DecompressionStream} by @returns {Promise<Uint8Array>} */
const through = async (data, by) =>
  new Uint8Array(await new Response(new Blob([/** @type {Uint8Array<ArrayBuffer>} */ (data)]).stream().pipeThrough(by)).arrayBuffer());

/** The program at the other end of a socket. */
export class Link {
  /** @param {Canvas} canvas @param {() => void} changed called when the state is another one @param {(lost: boolean) => void} lost */
  constructor(canvas, changed, lost) {
    this.canvas = canvas;
    this.changed = changed;
    this.lost = lost;
    /** @type {Record<string, any>} */ this.state = {};
    /** @type {Record<string, Control>} */ this.controls = {};
    this.counters = { received: 0, sent: 0, messages: 0, lastSent: 0, lastReceived: 0 };
    this.settled = () => {}; // called when the program has done what it was asked for
    this.scene = { number: 0, count: 0 };
    this.started = 0;
    /** @type {number[]} */ this.starts = [];
    /** @type {Map<number, Uint32Array>} */ this.layers = new Map();
    this.tab = "";
    this.queue = Promise.resolve();
    this.connect();
  }

  /** Connect again, to a program that proves that it has the key: another one that listens at the port now is not sent it. */
  async reconnect() {
    const nonce = [...crypto.getRandomValues(new Uint8Array(16))].map((byte) => byte.toString(16).padStart(2, "0")).join("");
    const bytes = new TextEncoder(), secret = bytes.encode(location.pathname.split("/")[1]);
    try {
      const key = await crypto.subtle.importKey("raw", secret, { name: "HMAC", hash: "SHA-256" }, false, ["verify"]);
      const proof = new Uint8Array(await (await fetch(`/proof/${nonce}`)).arrayBuffer());
      if (await crypto.subtle.verify("HMAC", key, proof, bytes.encode(nonce))) return this.connect();
    } catch {} // nobody listens
    setTimeout(() => this.reconnect(), RETRY_MILLISECONDS);
  }

  connect() {
    const socket = new WebSocket(`${location.protocol.replace("http", "ws")}//${location.host}${location.pathname}socket`);
    socket.binaryType = "arraybuffer";
    const late = setTimeout(() => this.socket !== socket && this.lost(true), LOST_MILLISECONDS);
    socket.onopen = () => (clearTimeout(late), clearTimeout(this.fading), (this.socket = socket), this.lost(false));
    socket.onmessage = ({ data }) => {
      this.counters.messages++;
      this.counters.received += this.counters.lastReceived = data.byteLength ?? data.length;
      this.queue = this.queue.then(() => this.hear(data)).catch((error) => console.error(error));
    };
    socket.onclose = () => {
      clearTimeout(late);
      if (this.socket === socket) (this.socket = undefined), (this.fading = setTimeout(() => this.lost(true), LOST_MILLISECONDS));
      setTimeout(() => this.reconnect(), RETRY_MILLISECONDS);
    };
  }

  /** Tell the program something. @param {Record<string, any>} message @param {Uint8Array=} rows bits of splats */
  async say(message, rows) {
    const { eye, target, up, fov, element } = this.canvas;
    const view = { eye, target, up, fov, width: element.clientWidth, height: element.clientHeight };
    const text = JSON.stringify(this.scene.count && element.clientWidth ? { ...message, view } : message);
    /** @type {string | Uint8Array} */ let data = text;
    if (rows) {
      const head = new TextEncoder().encode(`${text}\0`), packed = await through(rows, new CompressionStream("deflate"));
      (data = new Uint8Array(head.length + packed.length)), data.set(head), data.set(packed, head.length);
    }
    this.counters.sent += this.counters.lastSent = data.length;
    this.socket?.send(/** @type {any} */ (data));
  }

  /** Set a control, here at once. @param {string} control @param {any} value */
  enter(control, value) {
    this.controls[control].value = value;
    this.changed();
    this.say({ is: "enter", control, value });
  }

  /** Send a file. @param {File} file @param {boolean} beside whether it is to be an object beside the open scene */
  async upload(file, beside) {
    await fetch(`upload/${encodeURIComponent(file.name)}?tab=${this.tab}${beside ? "&beside" : ""}`, { method: "POST", body: file });
  }

  /** @param {string | ArrayBuffer} data */
  async hear(data) {
    if (typeof data !== "string") return this.takeStates(new Uint8Array(data));
    const message = JSON.parse(data);
    if (message.tab) (this.tab = message.tab), (this.state = {}), (this.controls = {});
    if (message.download) Object.assign(document.createElement("a"), { href: message.download, download: message.name }).click();
    if (message.look) this.canvas.look(message.look[0], message.look[1]);
    if (!message.state) return;
    for (const [name, value] of Object.entries(message.state)) name[0] === "=" ? (this.controls[name.slice(1)] = value) : (this.state[name] = value);
    const { drawn, start, upwards } = this.state;
    if (upwards) this.canvas.up = upwards;
    if ((drawn?.number ?? 0) !== this.scene.number) this.load(drawn ?? { number: 0, count: 0, shown: 0, covered: [], harmonics: 0, tones: [0, 1] });
    if (start && start[0] !== this.started) (this.started = start[0]), this.canvas.look(start[1], start[2]);
    if ((this.state.share ?? null) === null) this.settled();
    this.changed();
  }

  /** Get the splats of a scene, the coarse one first. @param {any} drawn */
  async load(drawn) {
    const { canvas } = this;
    this.scene = drawn;
    this.starts = [0]; // first row of each portion
    for (let portion = 0; portion < PORTIONS - 1; portion++) this.starts.push(this.starts[portion] + Math.max(0, Math.ceil((drawn.count - portion) / PORTIONS)));
    this.layers.clear();
    canvas.open(drawn);
    if (!drawn.count) return canvas.stateChanged();
    const reader = (await fetch(`splats/${drawn.number}`)).body?.getReader();
    for (let left = new Uint8Array(0); reader; ) {
      const { done, value } = await reader.read();
      if (done) return;
      if (this.scene !== drawn) return reader.cancel();
      const bytes = new Uint8Array(left.length + value.length);
      bytes.set(left), bytes.set(value, left.length);
      const whole = bytes.length - (bytes.length % (4 * WORDS));
      canvas.grow(new Uint32Array(bytes.buffer, 0, whole / 4));
      left = bytes.slice(whole);
    }
  }

  /** Row of the page of a splat, of which the program counts those near each other. @param {number} m */
  rowOf(m) {
    return this.starts[m % PORTIONS] + Math.floor(m / PORTIONS);
  }

  /** Bits of splats, in the program's order. @param {Iterable<number>} rows of the page */
  bits(rows) {
    const bits = new Uint8Array(Math.ceil(this.scene.count / 8)), { starts } = this;
    for (const row of rows) {
      let portion = PORTIONS - 1;
      while (starts[portion] > row) portion--;
      const m = (row - starts[portion]) * PORTIONS + portion;
      bits[m >> 3] |= 1 << (m & 7);
    }
    return bits;
  }

  /** @param {Uint8Array} data what has changed, as `changes_as_bytes` writes it */
  async takeStates(data) {
    const { canvas } = this, end = data.indexOf(10), head = JSON.parse(new TextDecoder().decode(data.subarray(0, end)));
    let at = end + 1;
    const parts = head.bytes.map((/** @type {number} */ length) => data.slice(at, (at += length)));
    const [changed, values, extras] = await Promise.all(parts.map((/** @type {Uint8Array} */ part) => through(part, new DecompressionStream("deflate"))));
    for (const [number] of head.layers)
      if (!this.layers.has(number)) this.layers.set(number, new Uint32Array(await (await fetch(`layer/${number}`)).arrayBuffer()));
    const planes = [BEFORE, AFTER, FLAGS], n = values.length / 3, all = canvas.total;
    if (head.whole) for (let i = 0; i < all; i++) for (const plane of planes) canvas.set(i, plane, 0);
    for (let m = 0, k = 0; m < this.scene.count; m++) {
      if (changed[m >> 3] === 0) {
        m |= 7;
        continue;
      }
      if (!(changed[m >> 3] & (1 << (m & 7)))) continue;
      const row = this.rowOf(m);
      if (row < all) for (const plane of planes) canvas.set(row, plane, values[plane * n + k]);
      k++;
    }
    canvas.setExtras(head.layers.map((/** @type {number[]} */ [number]) => this.layers.get(number)), extras);
    this.settled();
  }
}
