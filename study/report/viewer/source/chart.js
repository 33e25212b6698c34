// Line charts as SVG: one panel with axes, lines, a band, a limit and a cursor.

import { ticks } from './colours.js';

const NAMESPACE = 'http://www.w3.org/2000/svg';
const LEFT = 46;
const RIGHT = 12;
const TOP = 20;
const BOTTOM = 18;

function add(parent, name, attributes, text) {
  const element = document.createElementNS(NAMESPACE, name);
  for (const [key, value] of Object.entries(attributes)) element.setAttribute(key, value);
  if (text !== undefined) element.textContent = text;
  parent.append(element);
  return element;
}

const digitsFor = (step) => Math.max(0, Math.min(4, -Math.floor(Math.log10(step) + 1e-9)));

export class Chart {
  /** `pick` is told the x of a place that was clicked or dragged to. */
  constructor(parent, { height, title, pick = null }) {
    this.parent = parent;
    this.height = height;
    this.title = title;
    this.svg = add(parent, 'svg', { role: 'img', 'aria-label': title, class: 'chart' });
    if (pick) this._listen(pick);
  }

  _listen(pick) {
    this.svg.classList.add('picked');
    const told = (event) => {
      const box = this.svg.getBoundingClientRect();
      const share = (event.clientX - box.left - LEFT) / (box.width - LEFT - RIGHT);
      const [low, high] = this.x;
      pick(low + Math.min(1, Math.max(0, share)) * (high - low));
    };
    this.svg.addEventListener('pointerdown', (event) => {
      this.svg.setPointerCapture(event.pointerId);
      told(event);
    });
    this.svg.addEventListener('pointermove', (event) => event.buttons & 1 && told(event));
  }

  /** Draw anew. `lines`: {x, y, class}; `band`: {x, low, high}; 0 or null in y is a gap. */
  draw({ x, y, lines, band = null, limit = null, marks = [], labelled = true, legend = [] }) {
    const width = Math.max(220, this.parent.clientWidth);
    const bottom = labelled ? BOTTOM : 6;
    this.x = x;
    this.across = (value) => LEFT + ((value - x[0]) / (x[1] - x[0])) * (width - LEFT - RIGHT);
    const high = this.height - bottom;
    this.down = (value) => high - ((value - y[0]) / (y[1] - y[0])) * (high - TOP);
    this.svg.replaceChildren();
    this.svg.setAttribute('viewBox', `0 0 ${width} ${this.height}`);
    this.svg.setAttribute('height', this.height);
    this._grid(x, y, width, high, labelled);
    if (band) {
      const upper = band.x.map((v, i) => `${this.across(v)},${this.down(band.high[i])}`);
      const lower = band.x.map((v, i) => `${this.across(v)},${this.down(band.low[i])}`).reverse();
      add(this.svg, 'polygon', { points: [...upper, ...lower].join(' '), class: 'band' });
    }
    if (limit !== null && limit > y[0]) {
      const at = this.down(limit);
      add(this.svg, 'line', { x1: LEFT, x2: width - RIGHT, y1: at, y2: at, class: 'limit' });
      const place = { x: width - RIGHT - 2, y: at - 4, class: 'limit', 'text-anchor': 'end' };
      add(this.svg, 'text', place, `limit ${limit.toFixed(2)}`);
    }
    this.lines = lines.map((line) => add(this.svg, 'path', { class: line.class, d: this.path(line) }));
    for (const mark of marks) {
      const at = `translate(${this.across(mark.x)} ${this.down(mark.y)}) rotate(45)`;
      add(this.svg, 'rect', { x: -4, y: -4, width: 8, height: 8, class: mark.class, transform: at });
    }
    add(this.svg, 'text', { x: 2, y: 12, class: 'name' }, this.title);
    this._legend(legend, width);
    this.rule = add(this.svg, 'line', { y1: TOP, y2: high, class: 'cursor' });
    this.dot = add(this.svg, 'circle', { r: 4, class: 'cursor', visibility: 'hidden' });
  }

  path({ x, y }) {
    let pen = 'M';
    let text = '';
    x.forEach((value, i) => {
      if (!y[i]) {
        pen = 'M';
        return;
      }
      text += `${pen}${this.across(value).toFixed(1)} ${this.down(y[i]).toFixed(1)}`;
      pen = 'L';
    });
    return text;
  }

  /** Move the cursor, and its dot where there is a value. */
  cursor(x, y = null) {
    const shown = x === null ? 'hidden' : 'visible';
    this.rule.setAttribute('visibility', shown);
    this.dot.setAttribute('visibility', y === null || x === null ? 'hidden' : 'visible');
    if (x === null) return;
    const at = this.across(x);
    this.rule.setAttribute('x1', at);
    this.rule.setAttribute('x2', at);
    if (y !== null) {
      this.dot.setAttribute('cx', at);
      this.dot.setAttribute('cy', this.down(y));
    }
  }

  _grid(x, y, width, high, labelled) {
    const heights = ticks(...y, Math.max(2, Math.round(this.height / 55)));
    const digits = digitsFor(heights[1] - heights[0] || 1);
    for (const value of heights) {
      const at = this.down(value);
      add(this.svg, 'line', { x1: LEFT, x2: width - RIGHT, y1: at, y2: at, class: 'grid' });
      const place = { x: LEFT - 6, y: at + 4, 'text-anchor': 'end', class: 'tick' };
      add(this.svg, 'text', place, value.toFixed(digits));
    }
    if (!labelled) return;
    const places = ticks(...x, Math.max(3, Math.floor(width / 130)));
    const decimals = digitsFor(places[1] - places[0] || 1);
    for (const value of places) {
      const place = { x: this.across(value), y: high + 14, 'text-anchor': 'middle', class: 'tick' };
      add(this.svg, 'text', place, value.toFixed(decimals));
    }
  }

  _legend(entries, width) {
    let at = width - RIGHT;
    for (const entry of [...entries].reverse()) {
      const text = add(this.svg, 'text', { y: 12, class: 'tick' }, entry.text);
      const length = 6.2 * entry.text.length;
      at -= length;
      text.setAttribute('x', at);
      add(this.svg, 'path', { class: entry.class, d: `M${at - 20} 8L${at - 5} 8` });
      at -= 32;
    }
  }
}
