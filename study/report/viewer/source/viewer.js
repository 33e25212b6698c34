// What is shown: a view of the page, an instant of its cycle, a place of the vessel.

import { scaleOf } from './colours.js';
import { hitOf, normalsOf, rowAt, valueAt } from './motion.js';

// Of 1 per mm shifted outwards and mm²: thousandths per mm² that is shifted by 0.1 mm.
const THOUSANDTHS = 100;

const extent = (values) => {
  let [low, high] = [Infinity, -Infinity];
  for (const value of values) {
    if (value < low) low = value;
    if (value > high) high = value;
  }
  return [low, high];
};

/** Distal outlet of a view, sections from the ostium on, or a point that was clicked. */
export class Viewer {
  constructor(page, colours, stage) {
    Object.assign(this, { page, colours, stage });
    this.exaggeration = 1;
    this.colour = 'ratio';
    this.time = 0; // from the start of the cycle [s]
    this.mark = { kind: 'distal' };
    this.show(page.views.length - 1);
  }

  get frames() {
    return this.view.t_s.length;
  }

  /** Time that the frames span [s]. */
  get span() {
    return this.view.t_s.at(-1);
  }

  /** The instant in frames: the first lies at 0; before it, in a whole cycle, comes the last. */
  get place() {
    const place = (this.time / this.span) * this.frames - 1;
    return place < 0 ? (this.view.whole ? place + this.frames : 0) : place;
  }

  show(number) {
    const share = this.view ? this.time / this.span : 0;
    const before = this.shape;
    this.number = number;
    this.view = this.page.views[number];
    this.shape = this.page.shapes[this.view.shape];
    this.time = share * this.span;
    const nodes = this.shape.node_s_mm.length;
    this.moved = new Float32Array(3 * nodes);
    if (this.shape !== before) {
      this.stage?.setShape(this.shape);
      if (before) this.mark = { kind: 'distal' };
    }
    if (!this.colourNames().includes(this.colour)) this.colour = 'ratio';
    this.rescale();
    this.refresh();
  }

  colourNames() {
    const { view } = this;
    const names = ['ratio', 'pressure'];
    if (view.moved_mm) names.push('moved');
    if (view.wider_per_mm3) names.push('wider');
    return names;
  }

  /** The scale of the colours, one for all views of the page. */
  rescale() {
    const views = this.page.views;
    const over = (name) => extent(views.flatMap((v) => (v[name] ? extent(v[name]) : [])));
    const { limit } = this.page;
    if (this.colour === 'ratio') {
      this.scale = scaleOf({ ...this.colours.ratio, high: 1, limit });
    } else if (this.colour === 'pressure') {
      const [low, high] = over('node_P_mmHg');
      this.scale = scaleOf({ low, high, colours: this.colours.pressure });
    } else if (this.colour === 'moved') {
      const most = Math.max(...views.map((v) => this.farthest(v)));
      this.scale = scaleOf({ low: 0, high: most, colours: this.colours.moved });
    } else {
      const most = Math.max(...views.map((v) => this.strongest(v)));
      this.scale = scaleOf({ low: -most, high: most, colours: this.colours.wider });
    }
    this.stage?.setScale(this.scale, this.colour === 'ratio' || this.colour === 'wider');
  }

  farthest(view) {
    if (!view.moved_mm) return 0;
    if (!view.farthest) {
      const m = view.moved_mm;
      let most = 0;
      for (let i = 0; i < m.length; i += 3) {
        most = Math.max(most, m[i] ** 2 + m[i + 1] ** 2 + m[i + 2] ** 2);
      }
      view.farthest = Math.sqrt(most);
    }
    return view.farthest;
  }

  /** Largest change by a wider lumen on the artery; on the other vessels colours end there. */
  strongest(view) {
    if (!view.wider_per_mm3) return 0;
    const s = this.page.shapes[view.shape].node_s_mm;
    const alone = s.every((v) => v < 0);
    const most = view.wider_per_mm3.reduce(
      (most, value, node) => (alone || s[node] >= 0 ? Math.max(most, Math.abs(value)) : most),
      0,
    );
    return THOUSANDTHS * most || 1;
  }

  /** Positions, normals, values and marks at the present instant. */
  refresh() {
    const { view, shape, stage, frames } = this;
    if (view.moved_mm) rowAt(view.moved_mm, this.moved.length, frames, this.place, this.moved);
    else this.moved.fill(0);
    if (!stage) return;
    const x = stage.array('position');
    for (let i = 0; i < x.length; i++) {
      x[i] = shape.points_mm[i] + this.exaggeration * this.moved[i];
    }
    normalsOf(x, shape.triangles, stage.array('normal'));
    this._fill(stage.array('value'));
    stage.touch('position', 'normal', 'value');
    stage.setRing(this.section === null ? null : this.ringOf(this.section, x));
    stage.setPoint(this.mark.kind === 'point' ? this._pointPlace(x) : null);
  }

  _fill(value) {
    const { view } = this;
    if (this.colour === 'ratio') value.set(view.node_ratio);
    else if (this.colour === 'wider') {
      for (let i = 0; i < value.length; i++) value[i] = THOUSANDTHS * view.wider_per_mm3[i];
    } else if (this.colour === 'pressure') {
      rowAt(view.node_P_mmHg, value.length, this.frames, this.place, value);
    } else {
      const m = this.moved;
      for (let i = 0; i < value.length; i++) {
        value[i] = Math.hypot(m[3 * i], m[3 * i + 1], m[3 * i + 2]);
      }
    }
  }

  /** Points of the ring of a section where the wall is drawn. */
  ringOf(k, x) {
    const { ring_sizes: sizes, ring_low: low, ring_high: high, ring_share: share } =
      this.shape.sections;
    const begin = sizes.slice(0, k).reduce((a, b) => a + b, 0);
    return Array.from({ length: sizes[k] }, (_, i) => {
      const [a, b, s] = [3 * low[begin + i], 3 * high[begin + i], share[begin + i]];
      return [0, 1, 2].map((j) => x[a + j] + s * (x[b + j] - x[a + j]));
    });
  }

  _pointPlace(x) {
    return [0, 1, 2].map((j) => valueAt(x, this.mark.point, 3, j));
  }

  /** Number of the section that belongs to the mark; null: none. */
  get section() {
    const { sections } = this.shape;
    if (!sections) return null;
    if (this.mark.kind === 'section') return this.mark.k;
    if (this.mark.kind === 'distal') return sections.s_mm.length - 1;
    const s = valueAt(this.shape.node_s_mm, this.mark.point);
    return this._onArtery() ? this.nearestSection(s) : null;
  }

  _onArtery() {
    return this.mark.point.nodes.every((node) => this.shape.node_s_mm[node] >= 0);
  }

  nearestSection(s) {
    const places = this.shape.sections.s_mm;
    return places.reduce((best, v, k) => (Math.abs(v - s) < Math.abs(places[best] - s) ? k : best), 0);
  }

  /** Mark what lies at a place of the canvas; false: nothing. */
  pick(x, y) {
    const [origin, direction] = this.stage.ray(x, y);
    const point = hitOf(origin, direction, this.stage.array('position'), this.shape.triangles);
    if (point) this.mark = { kind: 'point', point };
    return Boolean(point);
  }

  /** The numbers at the mark. */
  reading() {
    const { view, shape, mark, section: k } = this;
    const nodes = shape.node_s_mm.length;
    const found = { kind: mark.kind, s: null, wider: null, moved: null };
    if (mark.kind === 'point') {
      found.s = this._onArtery() ? valueAt(shape.node_s_mm, mark.point) : null;
      found.ratio = valueAt(view.node_ratio, mark.point);
      found.wave = view.t_s.map((_, f) => valueAt(view.node_P_mmHg, mark.point, 1, 0, f * nodes));
      found.moved = Math.hypot(...[0, 1, 2].map((j) => valueAt(this.moved, mark.point, 3, j)));
      if (view.wider_per_mm3) found.wider = THOUSANDTHS * valueAt(view.wider_per_mm3, mark.point);
    } else if (mark.kind === 'distal') {
      found.s = view.distal_s_mm;
      found.ratio = view.P_distal_mean_mmHg / view.P_aorta_mean_mmHg;
      found.wave = view.P_distal_mmHg;
    } else {
      const course = view.sections;
      const n = course.ratio.length;
      found.s = shape.sections.s_mm[k];
      found.ratio = course.ratio[k];
      found.wave = view.t_s.map((_, f) => course.P_mmHg[f * n + k]);
    }
    found.mean = found.ratio * view.P_aorta_mean_mmHg;
    found.now = this.at(found.wave);
    for (const name of ['area_mm2', 'minor_mm']) found[name] = k === null ? null : this._size(name, k);
    return found;
  }

  _size(name, k) {
    const n = this.shape.sections.s_mm.length;
    const wave = this.view.t_s.map((_, f) => this.view.sections[name][f * n + k]);
    const seen = wave.filter((value) => value > 0);
    const image = this.shape.sections[name.replace('_mm', '_image_mm')][k];
    return { wave, now: this.at(wave), least: Math.min(...seen), most: Math.max(...seen), image };
  }

  /** A course over the cycle at the present instant. */
  at(wave) {
    const out = [0];
    return rowAt(wave, 1, this.frames, this.place, out)[0];
  }

  /** Times and values of a course from the start of the cycle on. */
  course(wave) {
    const { t_s: t, whole } = this.view;
    return whole ? { x: [0, ...t], y: [wave[wave.length - 1], ...wave] } : { x: t, y: wave };
  }

  /** Sizes of all sections at the present instant. */
  sizesNow(name) {
    const n = this.shape.sections.s_mm.length;
    return rowAt(this.view.sections[name], n, this.frames, this.place, new Float64Array(n));
  }

  /** Least and largest size of each section over the cycle. */
  band(name) {
    const n = this.shape.sections.s_mm.length;
    const low = new Array(n).fill(Infinity);
    const high = new Array(n).fill(-Infinity);
    this.view.sections[name].forEach((value, i) => {
      if (!value) return;
      low[i % n] = Math.min(low[i % n], value);
      high[i % n] = Math.max(high[i % n], value);
    });
    return { low, high };
  }
}
