// Arrays as study/report/packed_array.py packs them, and those of a page by name.

const bytesOf = (text) => Uint8Array.from(atob(text), (letter) => letter.charCodeAt(0));

async function inflated(bytes) {
  const stream = new Blob([bytes]).stream().pipeThrough(new DecompressionStream('deflate'));
  return new Uint8Array(await new Response(stream).arrayBuffer());
}

/** The numbers of a packed array, row by row; null stays null. */
export async function unpack(packed) {
  if (!packed) return null;
  const raw = await inflated(bytesOf(packed.data));
  const n = packed.shape.reduce((a, b) => a * b, 1);
  const row = n / packed.shape[0];
  const whole = new Int32Array(n);
  for (let i = 0; i < n; i++) {
    let folded = 0;
    for (let byte = packed.width - 1; byte >= 0; byte--) folded = folded * 256 + raw[byte * n + i];
    const step = folded & 1 ? -((folded + 1) / 2) : folded / 2;
    whole[i] = step + (i < row ? 0 : whole[i - row]);
  }
  return Float64Array.from(whole, (value) => packed.low + packed.quantum * value);
}

async function unpackedFields(entry) {
  const names = Object.keys(entry);
  const values = await Promise.all(
    names.map((name) => (entry[name] && entry[name].data ? unpack(entry[name]) : entry[name])),
  );
  return Object.fromEntries(names.map((name, i) => [name, values[i]]));
}

async function unpackedPart(entry) {
  const part = await unpackedFields(entry);
  part.sections = part.sections && (await unpackedFields(part.sections));
  return part;
}

/** Shapes and views of a page, their arrays as numbers. */
export async function unpackPage(page) {
  const [shapes, views] = await Promise.all([
    Promise.all(page.shapes.map(unpackedPart)),
    Promise.all(page.views.map(unpackedPart)),
  ]);
  for (const shape of shapes) shape.triangles = Uint32Array.from(shape.triangles);
  return { ...page, shapes, views };
}
