// Scales of colours: 256 steps for the card, and the same for the legend.

const STEPS = 256;

const rgb = (hex) => [1, 3, 5].map((i) => parseInt(hex.slice(i, i + 2), 16));

function between(colours, share) {
  const place = Math.min(Math.max(share, 0), 1) * (colours.length - 1);
  const k = Math.min(Math.floor(place), colours.length - 2);
  const [a, b] = [rgb(colours[k]), rgb(colours[k + 1])];
  return a.map((value, i) => Math.round(value + (place - k) * (b[i] - value)));
}

/** A scale from low to high; with a limit, one set of colours ends there and another begins. */
export function scaleOf({ low, high, colours, below, limit = null }) {
  const bytes = new Uint8Array(4 * STEPS);
  for (let k = 0; k < STEPS; k++) {
    const value = low + ((k + 0.5) / STEPS) * (high - low);
    const colour =
      limit === null
        ? between(colours, (value - low) / (high - low))
        : value <= limit
          ? between(below, (value - low) / (limit - low))
          : between(colours, (value - limit) / (high - limit));
    bytes.set([...colour, 255], 4 * k);
  }
  return { low, high, limit, bytes };
}

/** Draw a scale into a canvas, low below. */
export function drawScale(canvas, scale) {
  canvas.width = 1;
  canvas.height = STEPS;
  const context = canvas.getContext('2d');
  const image = context.createImageData(1, STEPS);
  for (let k = 0; k < STEPS; k++) {
    image.data.set(scale.bytes.subarray(4 * k, 4 * k + 4), 4 * (STEPS - 1 - k));
  }
  context.putImageData(image, 0, 0);
}

/** Round numbers from low to high, at least so many but for one. */
export function ticks(low, high, about = 5) {
  const raw = (high - low) / about;
  const power = 10 ** Math.floor(Math.log10(raw));
  const step = power * [5, 2, 1].find((m) => m * power <= raw * 1.001);
  const found = [];
  for (let k = Math.ceil(low / step - 1e-9); k * step <= high + 1e-9 * step; k++) {
    found.push(k * step);
  }
  return found;
}
