// The lumen at an instant: positions, normals and values, from frames that repeat each cycle.

/** Frame before a place of the cycle, the one after it, and the share of the latter. */
export function around(place, frames) {
  const whole = Math.floor(place);
  const first = ((whole % frames) + frames) % frames;
  return [first, (first + 1) % frames, place - whole];
}

/** A row of values between frames, `width` numbers a frame, into `out`. */
export function rowAt(values, width, frames, place, out) {
  const [a, b, share] = around(place, frames);
  for (let i = 0; i < width; i++) {
    const before = values[a * width + i];
    out[i] = before + share * (values[b * width + i] - before);
  }
  return out;
}

/** Unit normals of a triangulated surface, faces weighed by their area. */
export function normalsOf(x, triangles, out) {
  out.fill(0);
  for (let t = 0; t < triangles.length; t += 3) {
    const [a, b, c] = [3 * triangles[t], 3 * triangles[t + 1], 3 * triangles[t + 2]];
    const [ux, uy, uz] = [x[b] - x[a], x[b + 1] - x[a + 1], x[b + 2] - x[a + 2]];
    const [vx, vy, vz] = [x[c] - x[a], x[c + 1] - x[a + 1], x[c + 2] - x[a + 2]];
    const [nx, ny, nz] = [uy * vz - uz * vy, uz * vx - ux * vz, ux * vy - uy * vx];
    for (const i of [a, b, c]) {
      out[i] += nx;
      out[i + 1] += ny;
      out[i + 2] += nz;
    }
  }
  for (let i = 0; i < out.length; i += 3) {
    const length = Math.hypot(out[i], out[i + 1], out[i + 2]) || 1;
    out[i] /= length;
    out[i + 1] /= length;
    out[i + 2] /= length;
  }
  return out;
}

/** Where a ray first meets a surface: triangle and weights of its corners; null: nowhere. */
export function hitOf(origin, direction, x, triangles) {
  let nearest = Infinity;
  let found = null;
  const [dx, dy, dz] = direction;
  for (let t = 0; t < triangles.length; t += 3) {
    const [a, b, c] = [3 * triangles[t], 3 * triangles[t + 1], 3 * triangles[t + 2]];
    const [ux, uy, uz] = [x[b] - x[a], x[b + 1] - x[a + 1], x[b + 2] - x[a + 2]];
    const [vx, vy, vz] = [x[c] - x[a], x[c + 1] - x[a + 1], x[c + 2] - x[a + 2]];
    const [px, py, pz] = [dy * vz - dz * vy, dz * vx - dx * vz, dx * vy - dy * vx];
    const size = ux * px + uy * py + uz * pz;
    if (Math.abs(size) < 1e-12) continue;
    const [wx, wy, wz] = [origin[0] - x[a], origin[1] - x[a + 1], origin[2] - x[a + 2]];
    const first = (wx * px + wy * py + wz * pz) / size;
    if (first < 0 || first > 1) continue;
    const [qx, qy, qz] = [wy * uz - wz * uy, wz * ux - wx * uz, wx * uy - wy * ux];
    const second = (dx * qx + dy * qy + dz * qz) / size;
    if (second < 0 || first + second > 1) continue;
    const distance = (vx * qx + vy * qy + vz * qz) / size;
    if (distance <= 0 || distance >= nearest) continue;
    nearest = distance;
    const nodes = [triangles[t], triangles[t + 1], triangles[t + 2]];
    found = { nodes, weights: [1 - first - second, first, second] };
  }
  return found;
}

/** A field at a point of a triangle; `component` of `width`. */
export function valueAt(values, point, width = 1, component = 0, offset = 0) {
  return point.nodes.reduce(
    (sum, node, i) => sum + point.weights[i] * values[offset + width * node + component],
    0,
  );
}
