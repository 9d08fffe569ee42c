// @ts-check
// Sorts splats by depth beside the drawing, in a worker: a radix sort of the depths' bits, which no outlier troubles.

/** @type {Float32Array} */
let centres = new Float32Array(0);
let depths = new Float32Array(0), keys = new Uint32Array(0), places = new Uint32Array(0), rows = new Uint32Array(0);
const low = new Uint32Array(65537), high = new Uint32Array(65537);

/**
 * Rows of what is shown, the farthest first.
 * @param {number[]} forward where the eye looks
 * @param {[number, number][]} ranges first and last row, exclusive, of what may be shown
 * @param {Uint8Array} shown whether each row is
 */
function sorted(forward, ranges, shown) {
  const [fx, fy, fz] = forward;
  let n = 0, nearest = Infinity;
  for (const [first, last] of ranges)
    for (let i = first; i < last; i++) {
      if (!shown[i]) continue;
      const depth = centres[3 * i] * fx + centres[3 * i + 1] * fy + centres[3 * i + 2] * fz;
      if (depth < nearest) nearest = depth;
      depths[n] = depth;
      rows[n++] = i;
    }
  low.fill(0), high.fill(0);
  for (let i = 0; i < n; i++) depths[i] -= nearest; // bits of floats from 0 on keep their order
  for (let i = 0; i < n; i++) {
    const key = ~keys[i];
    low[(key & 65535) + 1]++;
    high[(key >>> 16) + 1]++;
  }
  for (let i = 0; i < 65536; i++) (low[i + 1] += low[i]), (high[i + 1] += high[i]);
  const found = new Uint32Array(n);
  for (let i = 0; i < n; i++) places[low[~keys[i] & 65535]++] = i;
  for (let i = 0; i < n; i++) found[high[~keys[places[i]] >>> 16]++] = rows[places[i]];
  return found;
}

onmessage = ({ data }) => {
  if (data.capacity !== undefined) {
    const n = data.capacity;
    centres = new Float32Array(3 * n);
    (depths = new Float32Array(n)), (keys = new Uint32Array(depths.buffer));
    (places = new Uint32Array(n)), (rows = new Uint32Array(n));
  } else if (data.centres) centres.set(data.centres, 3 * data.at);
  else {
    const found = sorted(data.forward, data.ranges, data.shown);
    postMessage({ rows: found, grown: data.grown, key: data.key }, { transfer: [found.buffer] });
  }
};
