"use strict";
// Draws Gaussians as EWA splatting does, back to front, each as a quad; see the page's source for the data's layout.

const VERTEX = `#version 300 es
precision highp float; precision highp int; precision highp usampler2D;
uniform usampler2D splats;   // two texels a Gaussian: x y z sx | sy sz rgba rotation
uniform mat3 rotation;       // world to camera: x right, y down, z forward
uniform vec3 translation;
uniform vec2 size;           // of the picture, in pixels
uniform float focal, near;
in vec2 corner;
in uint row;
out vec2 place;
out vec4 colour;

vec4 bytes(uint word) {
  return vec4(word & 255u, (word >> 8) & 255u, (word >> 16) & 255u, word >> 24);
}

void main() {
  gl_Position = vec4(0.0, 0.0, 2.0, 1.0);  // outside, unless it is found to show
  int width = textureSize(splats, 0).x, texel = int(row) * 2;
  ivec2 at = ivec2(texel % width, texel / width);
  uvec4 first = texelFetch(splats, at, 0), second = texelFetch(splats, at + ivec2(1, 0), 0);
  vec3 centre = rotation * uintBitsToFloat(first.xyz) + translation;
  colour = bytes(second.z) / 255.0;
  if (centre.z < near || colour.a < 1.0 / 255.0) return;

  vec4 q = normalize((bytes(second.w) - 128.0) / 128.0 + vec4(1e-9, 0.0, 0.0, 0.0));
  vec3 scale = vec3(uintBitsToFloat(first.w), uintBitsToFloat(second.xy));
  mat3 turn = mat3(
    1.0 - 2.0 * (q.z * q.z + q.w * q.w), 2.0 * (q.y * q.z + q.x * q.w), 2.0 * (q.y * q.w - q.x * q.z),
    2.0 * (q.y * q.z - q.x * q.w), 1.0 - 2.0 * (q.y * q.y + q.w * q.w), 2.0 * (q.z * q.w + q.x * q.y),
    2.0 * (q.y * q.w + q.x * q.z), 2.0 * (q.z * q.w - q.x * q.y), 1.0 - 2.0 * (q.y * q.y + q.z * q.z));
  mat3 axes = rotation * turn;
  axes[0] *= scale.x; axes[1] *= scale.y; axes[2] *= scale.z;

  // The projection's Jacobian, evaluated no farther outside the picture than a part of its size.
  vec2 limit = 0.65 * size / focal, slope = clamp(centre.xy / centre.z, -limit, limit);
  float scaled = focal / centre.z;
  vec3 across = vec3(scaled, 0.0, -scaled * slope.x) * axes, down = vec3(0.0, scaled, -scaled * slope.y) * axes;
  float a = dot(across, across) + 0.3, b = dot(across, down), c = dot(down, down) + 0.3;
  float middle = 0.5 * (a + c), apart = length(vec2(0.5 * (a - c), b));
  float major = middle + apart, minor = max(middle - apart, 0.3);
  vec2 axis = abs(b) > 1e-6 * middle ? normalize(vec2(b, major - a)) : a >= c ? vec2(1.0, 0.0) : vec2(0.0, 1.0);

  float reach = sqrt(2.0 * log(255.0 * colour.a));  // standard deviations at which alpha falls to 1/255
  place = reach * corner;
  vec2 offset = place.x * min(sqrt(major), 4096.0) * axis
    + place.y * min(sqrt(minor), 4096.0) * vec2(-axis.y, axis.x);
  vec2 pixel = focal * centre.xy / centre.z + offset;
  gl_Position = vec4(2.0 * pixel.x / size.x, -2.0 * pixel.y / size.y, 0.0, 1.0);
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

// Rows of the shown ranges, the farthest first: a radix sort of the depths' bits, which has no trouble with outliers.
function sortByDepth(centres, ranges, forward) {
  let count = 0, nearest = Infinity;
  for (const [first, last] of ranges) count += last - first;
  const depths = new Float32Array(count), rows = new Uint32Array(count), sorted = new Uint32Array(count);
  let n = 0;
  for (const [first, last] of ranges) {
    for (let i = first; i < last; i++) {
      const depth = centres[3 * i] * forward[0] + centres[3 * i + 1] * forward[1] + centres[3 * i + 2] * forward[2];
      if (depth < nearest) nearest = depth;
      depths[n] = depth;
      rows[n++] = i;
    }
  }
  for (let i = 0; i < count; i++) depths[i] -= nearest;
  const keys = new Uint32Array(depths.buffer), places = new Uint32Array(count);  // bits of floats from 0 on keep order
  const low = new Uint32Array(65537), high = new Uint32Array(65537);
  for (let i = 0; i < count; i++) {
    const key = ~keys[i];
    low[(key & 65535) + 1]++;
    high[(key >>> 16) + 1]++;
  }
  for (let i = 0; i < 65536; i++) {
    low[i + 1] += low[i];
    high[i + 1] += high[i];
  }
  for (let i = 0; i < count; i++) places[low[~keys[i] & 65535]++] = i;
  for (let i = 0; i < count; i++) sorted[high[~keys[places[i]] >>> 16]++] = rows[places[i]];
  return sorted;
}

function sortInWorker() {
  let centres = null;
  onmessage = event => {
    if (event.data.centres) centres = event.data.centres;
    else {
      const sorted = sortByDepth(centres, event.data.ranges, event.data.forward);
      postMessage(sorted, [sorted.buffer]);
    }
  };
}

const settings = JSON.parse(document.getElementById("settings").textContent);
const canvas = document.getElementById("canvas"), stage = document.getElementById("stage");
const message = document.getElementById("message");
const splats = decoded(document.getElementById("splats"));
const count = splats.length / 32;
const centres = new Float32Array(3 * count);
{
  const numbers = new Float32Array(splats.buffer);
  for (let i = 0; i < count; i++) centres.set(numbers.subarray(8 * i, 8 * i + 3), 3 * i);
}
const start = { yaw: settings.yaw, pitch: settings.pitch, distance: settings.distance, target: settings.centre };
const view = { ...start };
let ranges = settings.parts.map(part => part.range), gl = null, where = {}, order = null;
let sortedFor = "", asked = "", drawing = 0, turning = 0;

function decoded(element) {
  const raw = atob(element.textContent.trim()), found = new Uint8Array(raw.length);
  for (let i = 0; i < raw.length; i++) found[i] = raw.charCodeAt(i);
  element.remove();
  return found;
}

function say(sentence) {
  message.textContent = sentence;
  message.hidden = !sentence;
}

// The camera stands on a sphere around the target; its axes are rows: right, down, forward.
function camera() {
  const [side, other, up] = settings.axes, { yaw, pitch, distance, target } = view;
  const level = add(scaled(side, Math.cos(yaw)), scaled(other, Math.sin(yaw)));
  const outward = add(scaled(level, Math.cos(pitch)), scaled(up, Math.sin(pitch)));
  const forward = scaled(outward, -1), right = scaled(unit(cross(forward, up)), 1), down = cross(forward, right);
  const eye = add(target, scaled(outward, distance));
  const focal = Math.min(canvas.width, canvas.height) / (2 * Math.tan(settings.fov / 2));
  return { eye, right, down, forward, focal };
}

const add = (a, b) => a.map((value, i) => value + b[i]);
const scaled = (a, factor) => a.map(value => value * factor);
const dot = (a, b) => a[0] * b[0] + a[1] * b[1] + a[2] * b[2];
const cross = (a, b) => [a[1] * b[2] - a[2] * b[1], a[2] * b[0] - a[0] * b[2], a[0] * b[1] - a[1] * b[0]];
const unit = a => scaled(a, 1 / Math.hypot(...a));

function begin() {
  gl = canvas.getContext("webgl2", { antialias: false, alpha: true, premultipliedAlpha: true, depth: false });
  if (!gl) {
    say("This page needs WebGL 2, which this browser lacks; try another browser, or newer graphics drivers.");
    return;
  }
  const program = gl.createProgram();
  for (const [kind, source] of [[gl.VERTEX_SHADER, VERTEX], [gl.FRAGMENT_SHADER, FRAGMENT]]) {
    const shader = gl.createShader(kind);
    gl.shaderSource(shader, source);
    gl.compileShader(shader);
    gl.attachShader(program, shader);
  }
  gl.linkProgram(program);
  if (!gl.getProgramParameter(program, gl.LINK_STATUS)) {
    if (!gl.isContextLost()) say("The graphics driver cannot run the page's shaders: " + gl.getProgramInfoLog(program));
    return;
  }
  gl.useProgram(program);
  for (const name of ["rotation", "translation", "size", "focal", "near"]) {
    where[name] = gl.getUniformLocation(program, name);
  }
  upload();
  const attributes = [["corner", 2, gl.FLOAT, 0], ["row", 1, gl.UNSIGNED_INT, 1]];
  for (const [name, components, kind, divisor] of attributes) {
    const place = gl.getAttribLocation(program, name);
    where[name] = gl.createBuffer();
    gl.bindBuffer(gl.ARRAY_BUFFER, where[name]);
    gl.enableVertexAttribArray(place);
    if (kind === gl.FLOAT) gl.vertexAttribPointer(place, components, kind, false, 0, 0);
    else gl.vertexAttribIPointer(place, components, kind, 0, 0);
    gl.vertexAttribDivisor(place, divisor);
  }
  gl.bindBuffer(gl.ARRAY_BUFFER, where.corner);
  gl.bufferData(gl.ARRAY_BUFFER, new Float32Array([-1, -1, 1, -1, -1, 1, 1, 1]), gl.STATIC_DRAW);
  gl.enable(gl.BLEND);
  gl.blendFunc(gl.ONE, gl.ONE_MINUS_SRC_ALPHA);
  gl.clearColor(0, 0, 0, 0);
  if (order) use(order);
  refresh();
}

function upload() {
  const width = 2048, height = Math.max(1, Math.ceil(2 * count / width));
  const texels = new Uint32Array(4 * width * height);
  texels.set(new Uint32Array(splats.buffer));
  gl.bindTexture(gl.TEXTURE_2D, gl.createTexture());
  gl.texParameteri(gl.TEXTURE_2D, gl.TEXTURE_MIN_FILTER, gl.NEAREST);
  gl.texParameteri(gl.TEXTURE_2D, gl.TEXTURE_MAG_FILTER, gl.NEAREST);
  gl.texImage2D(gl.TEXTURE_2D, 0, gl.RGBA32UI, width, height, 0, gl.RGBA_INTEGER, gl.UNSIGNED_INT, texels);
}

function use(rows) {
  order = rows;
  if (!gl) return;
  gl.bindBuffer(gl.ARRAY_BUFFER, where.row);
  gl.bufferData(gl.ARRAY_BUFFER, rows, gl.DYNAMIC_DRAW);
}

// Sorting runs beside the drawing; where no worker can be had, before it.
let sorter = null;
try {
  const source = `${sortByDepth}\n(${sortInWorker})();`;
  sorter = new Worker(URL.createObjectURL(new Blob([source], { type: "text/javascript" })));
  sorter.onmessage = event => {
    sortedFor = asked;
    asked = "";
    use(event.data);
    refresh();
  };
  sorter.onerror = () => {
    sorter = null;
    asked = "";
    refresh();
  };
  sorter.postMessage({ centres });
} catch {
  sorter = null;
}

function sort(forward) {
  const key = JSON.stringify([ranges, forward]);
  if (key === sortedFor || asked) return;
  if (sorter) {
    asked = key;
    sorter.postMessage({ ranges, forward });
  } else {
    sortedFor = key;
    use(sortByDepth(centres, ranges, forward));
  }
}

function draw() {
  if (!gl || gl.isContextLost()) return;
  const ratio = Math.min(devicePixelRatio || 1, 2);
  const width = Math.max(1, Math.round(canvas.clientWidth * ratio));
  const height = Math.max(1, Math.round(canvas.clientHeight * ratio));
  if (canvas.width !== width || canvas.height !== height) Object.assign(canvas, { width, height });
  const { eye, right, down, forward, focal } = camera();
  sort(forward);
  gl.viewport(0, 0, width, height);
  gl.clear(gl.COLOR_BUFFER_BIT);
  if (!order) return;
  gl.uniformMatrix3fv(where.rotation, true, [...right, ...down, ...forward]);
  gl.uniform3f(where.translation, -dot(right, eye), -dot(down, eye), -dot(forward, eye));
  gl.uniform2f(where.size, width, height);
  gl.uniform1f(where.focal, focal);
  gl.uniform1f(where.near, settings.near);
  gl.drawArraysInstanced(gl.TRIANGLE_STRIP, 0, 4, order.length);
}

function refresh() {
  drawing ||= requestAnimationFrame(now => {
    drawing = 0;
    if (turning) {
      view.yaw += Math.min(now - turning, 100) * 2 * Math.PI / 12000;
      turning = now;
      refresh();
    }
    draw();
  });
}

const STEEPEST = 1.55;

function orbit(yaw, pitch) {
  view.yaw += yaw;
  view.pitch = Math.min(STEEPEST, Math.max(-STEEPEST, view.pitch + pitch));
  refresh();
}

function zoom(factor) {
  view.distance = Math.min(1000 * start.distance, Math.max(settings.near, view.distance * factor));
  refresh();
}

function pan(x, y) {  // in CSS pixels
  const { right, down } = camera();
  const unitsAPixel = 2 * Math.tan(settings.fov / 2) * view.distance / Math.min(canvas.clientWidth, canvas.clientHeight);
  view.target = add(view.target, add(scaled(right, -x * unitsAPixel), scaled(down, -y * unitsAPixel)));
  refresh();
}

function turn(on) {
  turning = on ? performance.now() : 0;
  document.getElementById("turn").setAttribute("aria-pressed", String(on));
  refresh();
}

function reset() {
  turn(false);
  Object.assign(view, start);
  refresh();
}

// One pointer turns, or moves with shift or another button; two pointers move and zoom.
const pointers = new Map();
canvas.addEventListener("pointerdown", event => {
  canvas.setPointerCapture(event.pointerId);
  pointers.set(event.pointerId, event);
  turn(false);
});
canvas.addEventListener("pointermove", event => {
  const before = pointers.get(event.pointerId);
  if (!before) return;
  const x = event.clientX - before.clientX, y = event.clientY - before.clientY;
  const other = [...pointers.values()].find(pointer => pointer.pointerId !== event.pointerId);
  if (other) {
    const apart = pointer => Math.hypot(pointer.clientX - other.clientX, pointer.clientY - other.clientY) || 1;
    zoom(apart(before) / apart(event));
    pan(x / 2, y / 2);
  } else if (event.shiftKey || event.buttons & 6) pan(x, y);
  else orbit(-x * 0.008, y * 0.008);
  pointers.set(event.pointerId, event);
});
for (const end of ["pointerup", "pointercancel"]) canvas.addEventListener(end, e => pointers.delete(e.pointerId));
canvas.addEventListener("wheel", event => {
  event.preventDefault();
  zoom(Math.exp(event.deltaY * (event.deltaMode ? 0.05 : 0.0015)));
}, { passive: false });
canvas.addEventListener("contextmenu", event => event.preventDefault());

const STEP = 0.1, KEYS = {
  ArrowLeft: [-1, 0], ArrowRight: [1, 0], ArrowUp: [0, 1], ArrowDown: [0, -1],
};
canvas.addEventListener("keydown", event => {
  if (event.ctrlKey || event.metaKey || event.altKey) return;
  const [x, y] = KEYS[event.key] || [];
  if (x !== undefined) {
    if (event.shiftKey) pan(-40 * x, 40 * y);
    else orbit(STEP * x, STEP * y);
  } else if (event.key === "+" || event.key === "=") zoom(0.9);
  else if (event.key === "-") zoom(1 / 0.9);
  else if (event.key === "Home") reset();
  else if (event.key === " ") turn(!turning);
  else return;
  event.preventDefault();
});

document.getElementById("turn").addEventListener("click", () => turn(!turning));
document.getElementById("reset").addEventListener("click", reset);
for (const choice of document.querySelectorAll("input[name=backdrop]")) {
  choice.addEventListener("change", () => { stage.className = choice.value; });
}
for (const choice of document.querySelectorAll("input[name=part]")) {
  choice.addEventListener("change", () => {
    ranges = settings.parts.filter(part => choice.value === "" || part.name === choice.value).map(part => part.range);
    refresh();
  });
}
canvas.addEventListener("webglcontextlost", event => {
  event.preventDefault();
  say("The graphics driver stopped; the picture returns when it does.");
});
canvas.addEventListener("webglcontextrestored", () => {
  say("");
  begin();
});
new ResizeObserver(refresh).observe(canvas);
begin();
