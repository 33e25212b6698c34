// The panels beside the vessel: pull-back curve, courses over the cycle, numbers at the mark.

import { Chart } from './chart.js';

const element = (id) => document.getElementById(id);
const span = (values, least = 0) => {
  const seen = values.filter((value) => Number.isFinite(value) && value > 0);
  const [low, high] = [Math.min(...seen), Math.max(...seen)];
  const room = Math.max(0.06 * (high - low), least);
  return [low - room, high + room];
};

// With its sign, a true minus, and two significant digits.
const thousandths = (value) => {
  const text = String(Number(Math.abs(value).toPrecision(2)));
  return `${text === '0' ? '' : value < 0 ? '−' : '+'}${text}`;
};

export class Panels {
  /** `told` is called with a change: {section} or {time}. */
  constructor(viewer, told) {
    this.viewer = viewer;
    const along = (s) => told({ s });
    const when = (time) => told({ time });
    const [pullback, waves] = [element('pullback'), element('waves')];
    this.ratio = new Chart(pullback, { height: 170, title: 'Pd/Pa', pick: along });
    this.area = new Chart(pullback, { height: 112, title: 'area [mm²]', pick: along });
    this.minor = new Chart(pullback, { height: 122, title: 'minor axis [mm]', pick: along });
    this.P = new Chart(waves, { height: 150, title: 'pressure [mmHg]', pick: when });
    this.size = new Chart(waves, { height: 120, title: 'lumen area [mm²]', pick: when });
  }

  /** Draw what changes with the view. */
  draw() {
    const { viewer } = this;
    const { view, shape, page, colours } = viewer;
    element('pullback-panel').hidden = !shape.sections;
    if (!shape.sections) return;
    const s = shape.sections.s_mm;
    const x = [0, Math.max(...s, view.distal_s_mm ?? 0)];
    const distal = view.P_distal_mean_mmHg / view.P_aorta_mean_mmHg;
    const y = [colours.ratio.low, Math.max(1.005, ...view.sections.ratio)];
    this.ratio.draw({
      x,
      y,
      limit: page.limit,
      labelled: false,
      lines: [{ x: [...s, view.distal_s_mm], y: [...view.sections.ratio, distal], class: 'first' }],
      marks: [{ x: view.distal_s_mm, y: distal, class: 'distal' }],
    });
    this._size(this.area, 'area', 'area_mm2', shape.sections.area_image_mm2, false);
    this._size(this.minor, 'minor', 'minor_mm', shape.sections.minor_image_mm, true);
  }

  _size(chart, name, key, image, labelled) {
    const { viewer, ratio } = this;
    const s = viewer.shape.sections.s_mm;
    const band = { x: s, ...viewer.band(key) };
    const y = [0, span([...band.high, ...image])[1]];
    const lines = [
      { x: s, y: image, class: 'image' },
      { x: s, y: viewer.sizesNow(key), class: 'first' },
    ];
    const legend = [
      { text: 'now', class: 'first' },
      { text: 'image', class: 'image' },
    ];
    chart.draw({ x: ratio.x, y, band, lines, labelled, legend });
  }

  /** Draw what changes with the mark. */
  drawWaves(reading) {
    const { viewer } = this;
    const { view } = viewer;
    const x = [0, viewer.span];
    const lines = [
      { ...viewer.course(view.P_aorta_mmHg), class: 'aorta' },
      { ...viewer.course(reading.wave), class: 'first' },
    ];
    const y = span([...view.P_aorta_mmHg, ...reading.wave], 1);
    const legend = [
      { text: 'here', class: 'first' },
      { text: 'aorta', class: 'aorta' },
    ];
    const size = reading.area_mm2;
    this.P.draw({ x, y, lines, legend, labelled: !size });
    this.size.svg.style.display = size ? '' : 'none';
    if (!size) return;
    const area = [{ ...viewer.course(size.wave), class: 'first' }];
    this.size.draw({ x, y: span([size.least, size.most], 0.02), lines: area });
  }

  /** Move what changes with the instant. */
  update(reading) {
    const { viewer } = this;
    const { shape } = viewer;
    if (shape.sections) {
      const s = shape.sections.s_mm;
      for (const [chart, key] of [[this.area, 'area_mm2'], [this.minor, 'minor_mm']]) {
        chart.lines[1].setAttribute('d', chart.path({ x: s, y: viewer.sizesNow(key) }));
      }
      this.ratio.cursor(reading.s, reading.ratio);
      this.area.cursor(reading.s, reading.area_mm2?.now || null);
      this.minor.cursor(reading.s, reading.minor_mm?.now || null);
    }
    this.P.cursor(viewer.time, reading.now);
    if (reading.area_mm2) this.size.cursor(viewer.time, reading.area_mm2.now || null);
    this._numbers(reading);
  }

  _numbers(reading) {
    const { viewer } = this;
    const size = (value, unit) =>
      value && `${value.now.toFixed(2)} ${unit} (${value.least.toFixed(2)} to ${value.most.toFixed(2)})`;
    const s = reading.s?.toFixed(1);
    const where = s === undefined ? 'outside of the artery' : `${s} mm from the ostium`;
    const texts = {
      where: reading.kind === 'distal' ? `distal outlet${s ? `, ${s} mm` : ''}` : where,
      ratio: reading.ratio.toFixed(3),
      mean: `${reading.mean.toFixed(1)} mmHg`,
      now: `${reading.now.toFixed(1)} mmHg`,
      area: size(reading.area_mm2, 'mm²'),
      minor: size(reading.minor_mm, 'mm'),
      moved: reading.moved !== null && viewer.view.moved_mm && `${reading.moved.toFixed(3)} mm`,
      wider: reading.wider !== null && `${thousandths(reading.wider)} · 10⁻³ per mm²`,
    };
    for (const [name, text] of Object.entries(texts)) {
      element(`at-${name}`).textContent = text || '–';
      element(`row-${name}`).hidden = !text;
    }
    element('at-ratio').dataset.value = String(reading.ratio);
    element('at-ratio').classList.toggle('low', reading.ratio <= viewer.page.limit);
  }
}
