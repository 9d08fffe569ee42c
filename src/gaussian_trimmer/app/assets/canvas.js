// @ts-check
// Draws splats as EWA splatting does, back to front, each as a quad, with WebGL 2. What is seen of a scene is decided by
// four bytes a splat, in a texture of their own, and a few uniforms: a stroke, a tint or another part costs no more than
// the bytes that change. `display.py` packs splats and says what the bytes mean.

/** @typedef {[number, number, number]} Vector */
/** @typedef {{eye: Vector, right: Vector, down: Vector, forward: Vector, focal: number}} Pose */
/** @typedef {[number, number, number, number]} Quaternion w first */
/** @typedef {{scale: number, turn: Quaternion, to: Vector}} Similarity a point x goes to scale * turned x + to */
/** @typedef {{part: number, when: number, colours: number, ghost: boolean}} Showing */

export const LINE = 1024; // splats in a line of the textures
export const BEFORE = 0, AFTER = 1, FLAGS = 2, LIVE = 3; // bytes of a splat's state
const ADDED = 1, REMOVED = 2, CUT = 4, MADE_UP = 8, PIECE = 16, FILL = 32, ACTIVE_REMOVED = 64, EXTRA = 128;
const GONE = PIECE, REPLACED = FILL; // of a splat of the scene itself
const OBJECT = 1, CHANGES = 2;
const NEAR_LINES = 8; // lines so near each other are uploaded as one
const SLOW_MILLISECONDS = 50, FEWEST = 40000, FEWEST_DEEP = 100000, REST_MILLISECONDS = 250;
const FOV = 50 * Math.PI / 180;

const VERTEX = `#version 300 es
precision highp float; precision highp int; precision highp usampler2D;
uniform usampler2D splats;  // two texels a splat: x y z scales | rgba rotation and two words of harmonics
uniform usampler2D states;
uniform sampler2D palette;  // colours of objects; alpha: whether they are seen
uniform sampler2D moves;    // where objects were moved to: quaternion, w first; translation and scale
uniform int moving;         // whether they are seen there
uniform mat3 rotation;      // world to camera: x right, y down, z forward
uniform vec3 translation, eye;
uniform vec2 size;          // of the picture, in pixels
uniform float focal, near, grown, harmonics;
uniform vec2 tones;         // colours of bytes 0 and 255
uniform ivec4 showing;      // part, when, colours, ghost
uniform uint chosen;        // number of the active object
uniform int deep;
in vec2 corner;
in uint row;
out vec2 place;
out vec4 colour;

vec4 bytes(uint word) { return vec4(word & 255u, (word >> 8) & 255u, (word >> 16) & 255u, word >> 24); }
float coefficient(uvec2 words, int i) {
  uint bits = i == 8 ? (words.x >> 28) | ((words.y >> 28) << 4) : (words[i / 4] >> uint(7 * (i % 4))) & 127u;
  return (float(bits) / 63.0 - 1.0) * harmonics;
}
mat3 matrix(vec4 q) {  // w first
  return mat3(
    1.0 - 2.0 * (q.z * q.z + q.w * q.w), 2.0 * (q.y * q.z + q.x * q.w), 2.0 * (q.y * q.w - q.x * q.z),
    2.0 * (q.y * q.z - q.x * q.w), 1.0 - 2.0 * (q.y * q.y + q.w * q.w), 2.0 * (q.z * q.w + q.x * q.y),
    2.0 * (q.y * q.w + q.x * q.z), 2.0 * (q.z * q.w - q.x * q.y), 1.0 - 2.0 * (q.y * q.y + q.z * q.z));
}
vec4 turn(uint word) {  // the three smaller parts of a quaternion, and which is the largest
  vec3 small = (vec3(word & 1023u, (word >> 10) & 1023u, (word >> 20) & 1023u) / 511.0 - 1.0) * 0.70710678;
  float rest = sqrt(max(0.0, 1.0 - dot(small, small)));
  uint which = word >> 30;
  return which == 0u ? vec4(rest, small) : which == 1u ? vec4(small.x, rest, small.yz)
    : which == 2u ? vec4(small.xy, rest, small.z) : vec4(small, rest);
}

void main() {
  gl_Position = vec4(0.0, 0.0, 2.0, 1.0);  // outside, unless it is found to show
  ivec2 at = ivec2(int(row) % ${LINE}, int(row) / ${LINE});
  uvec4 state = texelFetch(states, at, 0);
  bool after = showing.y == 1, ghost = showing.w == 1;
  uint owner = after ? state.y : state.x, flags = state.z;
  vec4 own = texelFetch(palette, ivec2(int(owner), 0), 0);
  bool shown;
  if ((flags & ${EXTRA}u) != 0u) {
    bool piece = (flags & ${PIECE}u) != 0u && (showing.x == ${OBJECT} ? owner == chosen : own.a > 0.0);
    shown = after && (piece || ((flags & ${FILL}u) != 0u && showing.x != ${OBJECT}));
  } else if (showing.x == ${OBJECT} && !ghost) {
    shown = (owner == chosen || (showing.z == ${CHANGES} && (flags & ${ACTIVE_REMOVED}u) != 0u)) && !(after && (flags & ${REPLACED}u) != 0u);
  } else {
    shown = own.a > 0.0 && !(after && (flags & ${GONE | REPLACED}u) != 0u);
  }
  if (!shown) return;

  ivec2 texel = ivec2(2 * at.x, at.y);
  uvec4 first = texelFetch(splats, texel, 0), second = texelFetch(splats, texel + ivec2(1, 0), 0);
  vec3 point = uintBitsToFloat(first.xyz);
  mat3 turned = mat3(1.0);
  float larger = 1.0;
  if (moving == 1 && owner != 0u) {
    vec4 to = texelFetch(moves, ivec2(int(owner), 1), 0);
    turned = matrix(texelFetch(moves, ivec2(int(owner), 0), 0)), larger = to.w;
    point = larger * (turned * point) + to.xyz;
  }
  vec3 centre = rotation * point + translation;
  colour = bytes(second.x) / 255.0;
  if (centre.z < near || colour.a < 1.0 / 255.0) return;
  vec3 rgb = mix(vec3(tones.x), vec3(tones.y), colour.rgb);
  if (harmonics > 0.0) {
    vec3 way = normalize(point - eye) * turned * 0.4886025;
    for (int i = 0; i < 3; i++) rgb[i] += -way.y * coefficient(second.zw, 3 * i) + way.z * coefficient(second.zw, 3 * i + 1)
      - way.x * coefficient(second.zw, 3 * i + 2);
  }
  rgb = clamp(rgb, 0.0, 1.0);
  if (ghost && owner != chosen) rgb = vec3(0.5), colour.a *= 0.15;
  vec3 tint = vec3(-1.0);
  if (showing.z == 1 && owner != 0u) tint = own.rgb;
  if (showing.z == ${CHANGES}) tint = (flags & ${ADDED}u) != 0u ? vec3(0.08, 0.71, 0.39) : (flags & ${REMOVED}u) != 0u ? vec3(0.87, 0.24, 0.16)
    : (flags & ${CUT}u) != 0u ? vec3(0.24, 0.51, 0.9) : (flags & ${MADE_UP}u) != 0u ? vec3(0.96, 0.88, 0.24) : tint;
  if (state.w == 1u) tint = texelFetch(palette, ivec2(int(chosen), 0), 0).rgb;  // what a stroke will add
  if (state.w == 2u) tint = vec3(0.87, 0.24, 0.16);
  if (tint.r >= 0.0) rgb = mix(rgb, tint, 0.6);

  vec3 scale = exp(vec3(first.w & 1023u, (first.w >> 10) & 1023u, (first.w >> 20) & 1023u) / 1023.0 * 20.0 - 14.0) * larger;
  if ((flags & ${EXTRA}u) == 0u) scale *= grown;
  mat3 axes = rotation * turned * matrix(turn(second.y));
  axes[0] *= scale.x; axes[1] *= scale.y; axes[2] *= scale.z;
  // The projection's Jacobian, evaluated no farther outside the picture than a part of its size.
  vec2 limit = 0.65 * size / focal, slope = clamp(centre.xy / centre.z, -limit, limit);
  float scaled = focal / centre.z;
  vec3 across = vec3(scaled, 0.0, -scaled * slope.x) * axes, down = vec3(0.0, scaled, -scaled * slope.y) * axes;
  float a = dot(across, across) + 0.3, b = dot(across, down), c = dot(down, down) + 0.3;
  float middle = 0.5 * (a + c), apart = length(vec2(0.5 * (a - c), b));
  float major = middle + apart, minor = max(middle - apart, 0.3);
  vec2 axis = abs(b) > 1e-6 * middle ? normalize(vec2(b, major - a)) : a >= c ? vec2(1.0, 0.0) : vec2(0.0, 1.0);
  place = sqrt(2.0 * log(255.0 * colour.a)) * corner;  // standard deviations at which alpha falls to 1/255
  vec2 offset = place.x * min(sqrt(major), 4096.0) * axis + place.y * min(sqrt(minor), 4096.0) * vec2(-axis.y, axis.x);
  vec2 pixel = focal * centre.xy / centre.z + offset;
  gl_Position = vec4(2.0 * pixel.x / size.x, -2.0 * pixel.y / size.y, 0.0, 1.0);
  colour.rgb = deep == 1 ? vec3(centre.z) : rgb;
}`;

const FRAGMENT = `#version 300 es
precision highp float;
in vec2 place;
in vec4 colour;
out vec4 drawn;
void main() {
  float alpha = min(0.99, colour.a * exp(-0.5 * dot(place, place)));
  if (alpha < 1.0 / 255.0) discard;
  drawn = vec4(colour.rgb * alpha, alpha);
}`;

export const add = (/** @type {Vector} */ a, /** @type {Vector} */ b) => /** @type {Vector} */ (a.map((value, i) => value + b[i]));
export const times = (/** @type {Vector} */ a, /** @type {number} */ by) => /** @type {Vector} */ (a.map((value) => value * by));
export const dot = (/** @type {Vector} */ a, /** @type {Vector} */ b) => a[0] * b[0] + a[1] * b[1] + a[2] * b[2];
export const cross = (/** @type {Vector} */ a, /** @type {Vector} */ b) =>
  /** @type {Vector} */ ([a[1] * b[2] - a[2] * b[1], a[2] * b[0] - a[0] * b[2], a[0] * b[1] - a[1] * b[0]]);
/** @param {Quaternion} a @param {Quaternion} b @returns {Quaternion} turns by b, then by a */
export const product = ([w, x, y, z], [W, X, Y, Z]) => [
  w * W - x * X - y * Y - z * Z, w * X + x * W + y * Z - z * Y, w * Y - x * Z + y * W + z * X, w * Z + x * Y - y * X + z * W,
];
/** @param {Similarity} by @param {Vector} point @returns {Vector} */
export function movedPoint({ scale, turn, to }, point) {
  const [w, ...axis] = turn, twice = times(cross(axis, point), 2);
  return add(times(add(point, add(times(twice, w), cross(axis, twice))), scale), to);
}
const unit = (/** @type {Vector} */ a) => times(a, 1 / (Math.hypot(...a) || 1));

/** A scene and the eye that looks at it, in the viewer's coordinates. */
export class Canvas {
  /** @param {HTMLCanvasElement} element @param {(sentence: string) => void} say called with what goes wrong */
  constructor(element, say) {
    this.element = element;
    this.say = say;
    this.count = 0; // splats of the scene that there are
    this.total = 0; // that come
    this.whole = 0; // that the scene has
    /** @type {number[]} */ this.covered = []; // share of it that is covered after each portion
    /** @type {WebGLFramebuffer | undefined} */ this.surfaceBuffer = undefined;
    this.seen = "";
    this.capacity = 0;
    this.states = new Uint8Array(0); // four bytes a splat
    this.texels = new Uint32Array(0); // eight words a splat
    this.dirty = new Uint8Array(0);
    this.extras = 0;
    this.tones = [0, 1];
    this.harmonics = 0;
    this.active = 1;
    /** @type {Uint8Array<ArrayBuffer>} */ this.palette = new Uint8Array(1024).fill(255);
    /** @type {Showing} */ this.showing = { part: 0, when: 0, colours: 1, ghost: false };
    /** @type {Vector} */ this.eye = [0, -5, 2];
    /** @type {Vector} */ this.target = [0, 0, 0];
    /** @type {Vector} */ this.up = [0, 0, 1];
    this.counters = { frames: 0, draws: 0, sorts: 0, uploaded: 0, lines: 0, instances: 0 };
    /** @type {(() => void)[]} */ this.followers = []; // called after each frame
    this.budget = Infinity; // splats that are drawn while the view moves
    this.moved = false;
    /** @type {(Similarity | null)[] | null} */ this.moves = null; // of objects, if they are seen where they were moved to
    this.grown = 1; // by how much splats are larger than they are, as there are fewer
    this.sorting = "";
    this.sortedFor = "";
    this.shownVersion = 0;
    this.shown = new Uint8Array(0);
    /** @type {Record<string, any>} */ this.where = {};
    /** @type {Uint32Array} */ this.order = new Uint32Array(0);
    this.worker = new Worker(new URL("./sort.js", import.meta.url));
    this.worker.onmessage = ({ data }) => {
      (this.sorting = ""), (this.sortedFor = data.key), (this.order = data.rows), (this.grown = data.grown);
      this.counters.sorts++;
      this.useOrder();
      this.refresh();
    };
    element.addEventListener("webglcontextlost", (event) => (event.preventDefault(), say("The graphics driver stopped; the picture returns when it does.")));
    element.addEventListener("webglcontextrestored", () => this.start());
    new ResizeObserver(() => this.refresh()).observe(element);
    this.start();
  }

  start() {
    const gl = this.element.getContext("webgl2", { antialias: false, alpha: true, premultipliedAlpha: true, depth: false });
    if (!gl) return this.say("This page needs WebGL 2, which this browser lacks; try another browser, or newer graphics drivers.");
    this.gl = gl;
    const program = gl.createProgram();
    for (const [kind, source] of /** @type {[number, string][]} */ ([[gl.VERTEX_SHADER, VERTEX], [gl.FRAGMENT_SHADER, FRAGMENT]])) {
      const shader = /** @type {WebGLShader} */ (gl.createShader(kind));
      gl.shaderSource(shader, source);
      gl.compileShader(shader);
      gl.attachShader(program, shader);
    }
    gl.linkProgram(program);
    if (!gl.getProgramParameter(program, gl.LINK_STATUS)) {
      const why = gl.getAttachedShaders(program)?.map((shader) => gl.getShaderInfoLog(shader)).join(" ");
      if (!gl.isContextLost()) this.say(`The graphics driver cannot run the page's shaders: ${gl.getProgramInfoLog(program)} ${why}`);
      return;
    }
    gl.useProgram(program);
    for (const name of ["splats", "states", "palette", "moves", "moving", "rotation", "translation", "eye", "size", "focal", "near", "grown", "harmonics", "tones", "showing", "chosen", "deep"])
      this.where[name] = gl.getUniformLocation(program, name);
    for (const [name, parts, kind, divisor] of /** @type {[string, number, number, number][]} */ ([["corner", 2, gl.FLOAT, 0], ["row", 1, gl.UNSIGNED_INT, 1]])) {
      const place = gl.getAttribLocation(program, name);
      this.where[`${name}s`] = gl.createBuffer();
      gl.bindBuffer(gl.ARRAY_BUFFER, this.where[`${name}s`]);
      gl.enableVertexAttribArray(place);
      if (kind === gl.FLOAT) gl.vertexAttribPointer(place, parts, kind, false, 0, 0);
      else gl.vertexAttribIPointer(place, parts, kind, 0, 0);
      gl.vertexAttribDivisor(place, divisor);
    }
    gl.bindBuffer(gl.ARRAY_BUFFER, this.where.corners);
    gl.bufferData(gl.ARRAY_BUFFER, new Float32Array([-1, -1, 1, -1, -1, 1, 1, 1]), gl.STATIC_DRAW);
    gl.enable(gl.BLEND);
    gl.blendFunc(gl.ONE, gl.ONE_MINUS_SRC_ALPHA);
    gl.clearColor(0, 0, 0, 0);
    gl.getExtension("EXT_color_buffer_float") || gl.getExtension("EXT_color_buffer_half_float");
    this.most = LINE * gl.getParameter(gl.MAX_TEXTURE_SIZE);
    for (const [slot, name] of ["splats", "states", "palette", "moves"].entries()) {
      gl.activeTexture(gl.TEXTURE0 + slot);
      gl.bindTexture(gl.TEXTURE_2D, gl.createTexture());
      for (const filter of [gl.TEXTURE_MIN_FILTER, gl.TEXTURE_MAG_FILTER]) gl.texParameteri(gl.TEXTURE_2D, filter, gl.NEAREST);
      gl.uniform1i(this.where[name], slot);
    }
    this.surfaceBuffer = undefined;
    if (this.capacity) this.allocate(), this.useOrder();
    this.usePalette();
    this.move(this.moves);
  }

  /** Make room for what is shown of a scene. @param {{count: number, shown: number, covered: number[], harmonics: number, tones: number[]}} scene */
  open({ count, shown, covered, harmonics, tones }) {
    this.covered = covered;
    (this.total = 0), (this.count = 0), (this.extras = 0), (this.harmonics = harmonics), (this.tones = tones);
    (this.texels = new Uint32Array(0)), (this.states = new Uint8Array(0));
    this.resize(shown);
    (this.total = shown), (this.whole = count);
    this.budget = Infinity;
  }

  /** More of the scene's splats are there. @param {Uint32Array} words eight a splat */
  grow(words) {
    const room = Math.min(words.length / 8, this.total - this.count);
    if (room <= 0) return;
    this.put(words.subarray(0, 8 * room), this.count);
    this.count += room;
    this.stateChanged();
  }

  /** Show splats beside the scene's. @param {Uint32Array[]} layers @param {Uint8Array} states their first bytes, then their second, third ones */
  setExtras(layers, states) {
    const n = states.length / 3;
    if (this.total + n > this.capacity) this.resize(this.total + n);
    let at = this.total;
    for (const layer of layers) if (layer.length) this.put(layer, at), (at += layer.length / 8);
    for (let i = 0; i < n; i++) for (const plane of [BEFORE, AFTER, FLAGS]) this.set(this.total + i, plane, states[plane * n + i]);
    this.extras = n;
    this.stateChanged();
  }

  /** @param {number} n splats that there is to be room for; those that are there stay */
  resize(n) {
    const lines = Math.max(1, Math.ceil((n + 16384) / LINE));
    const [texels, states] = [this.texels, this.states];
    this.capacity = lines * LINE;
    (this.texels = new Uint32Array(8 * this.capacity)), (this.states = new Uint8Array(4 * this.capacity));
    this.texels.set(texels.subarray(0, 8 * Math.min(this.total, this.capacity)));
    this.states.set(states.subarray(0, 4 * Math.min(this.total, this.capacity)));
    (this.dirty = new Uint8Array(lines)), (this.shown = new Uint8Array(this.capacity));
    this.worker.postMessage({ capacity: this.capacity });
    if (this.count) this.tellCentres(0, this.count);
    this.shownVersion++;
    this.order = new Uint32Array(0);
    this.sortedFor = "";
    this.allocate();
  }

  allocate() {
    const { gl } = this;
    if (!gl) return;
    const lines = this.capacity / LINE;
    gl.activeTexture(gl.TEXTURE0);
    gl.texImage2D(gl.TEXTURE_2D, 0, gl.RGBA32UI, 2 * LINE, lines, 0, gl.RGBA_INTEGER, gl.UNSIGNED_INT, this.texels);
    gl.activeTexture(gl.TEXTURE1);
    gl.texImage2D(gl.TEXTURE_2D, 0, gl.RGBA8UI, LINE, lines, 0, gl.RGBA_INTEGER, gl.UNSIGNED_BYTE, this.states);
    this.dirty.fill(0);
  }

  /** Take splats in. @param {Uint32Array} words eight a splat @param {number} at the first one's row */
  put(words, at) {
    this.texels.set(words, 8 * at);
    const { gl } = this, last = at + words.length / 8, first = Math.floor(at / LINE), end = Math.ceil(last / LINE);
    if (gl) {
      gl.activeTexture(gl.TEXTURE0);
      gl.texSubImage2D(gl.TEXTURE_2D, 0, 0, first, 2 * LINE, end - first, gl.RGBA_INTEGER, gl.UNSIGNED_INT, this.texels.subarray(8 * first * LINE, 8 * end * LINE));
    }
    this.tellCentres(at, last);
  }

  /** @param {number} at @param {number} last */
  tellCentres(at, last) {
    const centres = new Float32Array(3 * (last - at)), numbers = new Float32Array(this.texels.buffer);
    for (let i = at; i < last; i++) for (let axis = 0; axis < 3; axis++) centres[3 * (i - at) + axis] = numbers[8 * i + axis];
    for (let i = at; this.moves && i < last; i++) {
      const moved = this.moves?.[this.states[4 * i + (this.showing.when ? AFTER : BEFORE)] - 1];
      if (moved) centres.set(movedPoint(moved, [numbers[8 * i], numbers[8 * i + 1], numbers[8 * i + 2]]), 3 * (i - at));
    }
    this.worker.postMessage({ centres, at }, [centres.buffer]);
  }

  /** Set a byte of a splat's state. @param {number} i @param {number} plane @param {number} value */
  set(i, plane, value) {
    if (this.states[4 * i + plane] === value) return;
    this.states[4 * i + plane] = value;
    this.dirty[Math.floor(i / LINE)] = 1;
  }

  /** What is seen may have changed, beyond tints. */
  stateChanged() {
    this.shownVersion++;
    this.refresh();
  }

  /** Whether a splat is seen, as the shader decides it. @param {number} i */
  isShown(i) {
    const { part, when, colours, ghost } = this.showing;
    const flags = this.states[4 * i + FLAGS], owner = this.states[4 * i + (when ? AFTER : BEFORE)], seen = this.palette[4 * owner + 3] > 0;
    if (flags & EXTRA)
      return when === 1 && ((flags & PIECE && (part === OBJECT ? owner === this.active : seen)) || (flags & FILL && part !== OBJECT));
    if (part === OBJECT && !ghost) return (owner === this.active || (colours === CHANGES && flags & ACTIVE_REMOVED)) && !(when && flags & REPLACED);
    return seen && !(when && flags & (GONE | REPLACED));
  }

  /** @param {Uint8Array<ArrayBuffer>} palette four bytes an object, 256 of them */
  setPalette(palette) {
    this.palette = palette;
    this.usePalette();
    this.stateChanged();
  }

  usePalette() {
    const { gl } = this;
    if (!gl) return;
    gl.activeTexture(gl.TEXTURE2);
    gl.texImage2D(gl.TEXTURE_2D, 0, gl.RGBA8, 256, 1, 0, gl.RGBA, gl.UNSIGNED_BYTE, this.palette);
  }

  /** See objects where they were moved to, or all where it is in the scene. @param {(Similarity | null)[] | null} moves @param {boolean} sorted whether they stay there */
  move(moves, sorted = true) {
    const { gl } = this, table = new Float32Array(2048);
    for (let i = 0; i < 256; i++) {
      const { scale, turn, to } = (i && moves?.[i - 1]) || { scale: 1, turn: [1, 0, 0, 0], to: [0, 0, 0] };
      table.set(turn, 4 * i), table.set([...to, scale], 1024 + 4 * i);
    }
    this.moves = moves;
    if (gl) {
      gl.activeTexture(gl.TEXTURE3);
      gl.texImage2D(gl.TEXTURE_2D, 0, gl.RGBA32F, 256, 2, 0, gl.RGBA, gl.FLOAT, table);
    }
    if (sorted && this.count) for (const [first, last] of this.allRanges()) this.tellCentres(first, last);
    if (sorted) this.shownVersion++;
    this.refresh();
  }

  useOrder(order = this.order) {
    const { gl } = this;
    if (!gl) return;
    gl.bindBuffer(gl.ARRAY_BUFFER, this.where.rows);
    gl.bufferData(gl.ARRAY_BUFFER, order, gl.DYNAMIC_DRAW);
  }

  /** The angle from the upper edge to the lower one; the shorter side of the picture always spans the same. */
  get fov() {
    const { clientWidth: width, clientHeight: height } = this.element;
    return 2 * Math.atan(Math.tan(FOV / 2) * Math.max(1, height / (width || height || 1)));
  }

  /** How wide a pixel is at a depth of one. */
  get pixel() {
    return (2 * Math.tan(this.fov / 2)) / this.element.clientHeight;
  }

  /** @returns {Pose} where the eye is and how it looks, x right, y down, z forward; focal length for a height of one */
  pose() {
    const forward = unit(add(this.target, times(this.eye, -1)));
    const side = cross(forward, this.up), right = unit(Math.hypot(...side) > 1e-6 ? side : cross(forward, [this.up[1], this.up[2], this.up[0]]));
    return { eye: this.eye, right, down: cross(forward, right), forward, focal: 0.5 / Math.tan(this.fov / 2) };
  }

  get near() {
    return 0.01;
  }

  /** Pixels of the page at which a point shows, and its depth. @param {Vector} point @param {Pose} pose */
  project(point, pose = this.pose()) {
    const away = add(point, times(pose.eye, -1)), depth = dot(away, pose.forward), box = this.element.getBoundingClientRect();
    const scale = pose.focal * box.height / depth;
    return { x: box.left + box.width / 2 + scale * dot(away, pose.right), y: box.top + box.height / 2 + scale * dot(away, pose.down), depth };
  }

  /** @param {Vector} eye @param {Vector} target */
  look(eye, target) {
    (this.eye = eye), (this.target = target);
    this.refresh();
  }

  /** Turn around the target. @param {number} yaw @param {number} pitch radians */
  orbit(yaw, pitch) {
    this.turnAway(this.target, yaw, pitch, (away) => (this.eye = add(this.target, away)));
  }

  /** Turn the head. @param {number} yaw @param {number} pitch */
  turn(yaw, pitch) {
    this.turnAway(this.eye, yaw, pitch, (away) => (this.target = add(this.eye, away)), this.target);
  }

  /** @param {Vector} middle @param {number} yaw @param {number} pitch @param {(away: Vector) => void} use @param {Vector} from */
  turnAway(middle, yaw, pitch, use, from = this.eye) {
    const up = unit(this.up), away = add(from, times(middle, -1)), length = Math.hypot(...away);
    const height = Math.asin(Math.max(-1, Math.min(1, dot(away, up) / (length || 1))));
    const flat = add(away, times(up, -dot(away, up))), level = unit(Math.hypot(...flat) > 1e-9 ? flat : this.pose().down), side = cross(up, level);
    const tilt = Math.max(-1.55, Math.min(1.55, height + pitch));
    use(times(add(times(add(times(level, Math.cos(yaw)), times(side, Math.sin(yaw))), Math.cos(tilt)), times(up, Math.sin(tilt))), length));
    this.viewMoved();
  }

  /** @param {number} factor of the distance from the target */
  zoom(factor) {
    this.eye = add(this.target, times(add(this.eye, times(this.target, -1)), factor));
    this.viewMoved();
  }

  /** Move eye and target. @param {number} x right @param {number} y down @param {number} z forward, relative to the distance */
  pan(x, y, z = 0) {
    const { right, down, forward } = this.pose(), distance = Math.hypot(...add(this.eye, times(this.target, -1)));
    const step = times(add(add(times(right, x), times(down, y)), times(forward, z)), distance);
    (this.eye = add(this.eye, step)), (this.target = add(this.target, step));
    this.viewMoved();
  }

  viewMoved() {
    this.moved = true;
    clearTimeout(this.resting);
    this.resting = setTimeout(() => ((this.moved = false), this.refresh()), REST_MILLISECONDS);
    this.refresh();
  }

  refresh() {
    this.drawing ||= requestAnimationFrame((now) => {
      this.drawing = 0;
      this.draw();
      if (this.moved) requestAnimationFrame((then) => this.adapt(then - now));
      for (const act of this.followers) act();
    });
  }

  /** Draw fewer splats while the view moves if a frame took long, and more if it did not. @param {number} milliseconds */
  adapt(milliseconds) {
    const drawn = Math.min(this.budget, this.count);
    if (milliseconds > SLOW_MILLISECONDS) this.budget = Math.max(FEWEST, drawn / 2);
    else if (milliseconds < SLOW_MILLISECONDS / 2) this.budget = 1.2 * drawn;
  }

  /** By how much splats are larger where only the first so many are drawn. @param {number} drawn */
  growth(drawn) {
    const { covered } = this, at = (covered.length * drawn) / Math.max(1, this.whole), portion = Math.min(covered.length - 1, Math.floor(at));
    const before = covered[portion - 1] ?? 0, share = before + Math.min(1, at - portion) * (covered[portion] - before);
    return share > 0 ? Math.sqrt(1 / share) : 1;
  }

  /** Rows of what may be drawn, and by how much splats are larger for those that are not. @returns {[[number, number][], number]} */
  ranges() {
    const drawn = Math.floor(this.moved ? Math.min(this.count, Math.max(FEWEST, this.budget)) : this.count);
    return [[[0, drawn], [this.total, this.total + this.extras]], this.growth(drawn)];
  }

  /** @param {Vector} forward @param {[number, number][]} ranges @param {number} grown */
  sort(forward, ranges, grown) {
    const key = `${forward.map((value) => value.toFixed(4))} ${ranges} ${this.shownVersion} ${Object.values(this.showing)}`;
    if (key === this.sortedFor || this.sorting) return;
    this.sorting = key;
    const seen = `${this.shownVersion} ${Object.values(this.showing)}`; // nothing that the view changes
    if (seen !== this.seen) {
      this.seen = seen;
      for (const [first, last] of this.allRanges()) for (let i = first; i < last; i++) this.shown[i] = this.isShown(i) ? 1 : 0;
    }
    this.worker.postMessage({ forward, ranges, shown: this.shown, grown, key });
  }

  /** @returns {[number, number][]} rows of all splats that are there */
  allRanges() {
    return [[0, this.count], [this.total, this.total + this.extras]];
  }

  sendStates() {
    const { gl, dirty } = this;
    if (!gl) return;
    gl.activeTexture(gl.TEXTURE1);
    for (let first = dirty.indexOf(1); first >= 0; first = dirty.indexOf(1, first)) {
      let last = first + 1;
      for (let line = first; line < Math.min(dirty.length, last + NEAR_LINES); line++) if (dirty[line]) (last = line + 1), (dirty[line] = 0);
      gl.texSubImage2D(gl.TEXTURE_2D, 0, 0, first, LINE, last - first, gl.RGBA_INTEGER, gl.UNSIGNED_BYTE, this.states.subarray(4 * first * LINE, 4 * last * LINE));
      this.counters.lines += last - first;
      this.counters.uploaded++;
      first = last;
    }
  }

  draw() {
    const { gl, element } = this;
    if (!gl || gl.isContextLost()) return;
    const ratio = Math.min(devicePixelRatio || 1, 2);
    const width = Math.max(1, Math.round(element.clientWidth * ratio)), height = Math.max(1, Math.round(element.clientHeight * ratio));
    if (element.width !== width || element.height !== height) Object.assign(element, { width, height });
    this.counters.frames++;
    const pose = this.pose(), [ranges, grown] = this.ranges();
    this.sort(pose.forward, ranges, grown);
    this.sendStates();
    this.paint(width, height, pose, this.grown, false);
  }

  /** @param {number} width @param {number} height @param {Pose} pose @param {number} grown @param {boolean} deep depths in place of colours */
  paint(width, height, pose, grown, deep, count = this.order.length) {
    const { gl, where } = this;
    if (!gl) return;
    gl.viewport(0, 0, width, height);
    gl.clear(gl.COLOR_BUFFER_BIT);
    if (!count) return;
    const { eye, right, down, forward } = pose, { part, when, colours, ghost } = this.showing;
    gl.uniformMatrix3fv(where.rotation, true, [...right, ...down, ...forward]);
    gl.uniform3f(where.translation, -dot(right, eye), -dot(down, eye), -dot(forward, eye));
    gl.uniform3f(where.eye, ...eye);
    gl.uniform2f(where.size, width, height);
    gl.uniform1f(where.focal, pose.focal * height);
    gl.uniform1f(where.near, this.near);
    gl.uniform1f(where.grown, grown);
    gl.uniform1f(where.harmonics, this.harmonics);
    gl.uniform2f(where.tones, this.tones[0], this.tones[1]);
    gl.uniform4i(where.showing, part, when, colours, ghost ? 1 : 0);
    gl.uniform1ui(where.chosen, this.active);
    gl.uniform1i(where.deep, deep ? 1 : 0);
    gl.uniform1i(where.moving, this.moves ? 1 : 0);
    gl.drawArraysInstanced(gl.TRIANGLE_STRIP, 0, 4, count);
    this.counters.draws++;
    this.counters.instances = count;
  }

  /** Depths of what shows, NaN where nothing does: a small picture. @param {number} step CSS pixels of one of its own */
  surface(step) {
    const { gl, element } = this, width = Math.ceil(element.clientWidth / step), height = Math.ceil(element.clientHeight / step);
    const depths = new Float32Array(width * height).fill(NaN);
    if (!gl) return { width, height, depths };
    this.surfaceBuffer ??= gl.createFramebuffer();
    gl.bindFramebuffer(gl.FRAMEBUFFER, this.surfaceBuffer);
    const target = gl.createRenderbuffer();
    gl.bindRenderbuffer(gl.RENDERBUFFER, target);
    gl.renderbufferStorage(gl.RENDERBUFFER, gl.RGBA16F, width, height);
    gl.framebufferRenderbuffer(gl.FRAMEBUFFER, gl.COLOR_ATTACHMENT0, gl.RENDERBUFFER, target);
    if (gl.checkFramebufferStatus(gl.FRAMEBUFFER) === gl.FRAMEBUFFER_COMPLETE) {
      const few = this.order.length > FEWEST_DEEP ? this.order.filter((row) => row < FEWEST_DEEP || row >= this.total) : this.order;
      this.useOrder(few);
      this.paint(width, height, this.pose(), this.growth(Math.min(this.total, FEWEST_DEEP)), true, few.length);
      this.useOrder();
      const pixels = new Float32Array(4 * width * height);
      gl.readPixels(0, 0, width, height, gl.RGBA, gl.FLOAT, pixels);
      for (let y = 0; y < height; y++)
        for (let x = 0; x < width; x++) {
          const at = 4 * ((height - 1 - y) * width + x);
          if (pixels[at + 3] > 0.2) depths[y * width + x] = pixels[at] / pixels[at + 3];
        }
    }
    gl.bindFramebuffer(gl.FRAMEBUFFER, null);
    gl.deleteRenderbuffer(target);
    this.refresh();
    return { width, height, depths };
  }
}
