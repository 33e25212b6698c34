// The page: reads its data, builds the controls and draws while something changes.

import { drawScale, ticks } from './colours.js';
import { unpackPage } from './decode.js';
import { Panels } from './panels.js';
import { selfTest } from './selftest.js';
import { Stage } from './stage.js';
import { Viewer } from './viewer.js';

const SLOWED = 4;
const TURN = 0.12; // rad a key
const CLICK = 4; // pixels that a click may move
const AXES = ['condition', 'outlet', 'wall'];
const element = (id) => document.getElementById(id);
const json = (id) => JSON.parse(element(id).textContent);
const called = (view) => (view.ratio_name === 'ffr' ? 'FFR' : 'resting Pd/Pa');
const conditionOf = (view, views) => {
  const several = new Set(views.map((v) => v.rule).filter(Boolean)).size > 1;
  return several && view.rule ? `${view.condition} (${view.rule})` : view.condition;
};

class Page {
  constructor(data, colours, stage) {
    this.stage = stage;
    this.viewer = new Viewer(data, colours, stage);
    this.panels = new Panels(this.viewer, (change) => this._told(change));
    this.words = data.views.map((view) => ({ ...view, condition: conditionOf(view, data.views) }));
    this.playing = false;
    this.changed = true;
    this._choices();
    this._controls();
    if (stage) this._stageControls();
    this._whole();
    new ResizeObserver(() => this._resize()).observe(element('stage-box'));
    this._resize();
    this._loop(performance.now());
  }

  _told(change) {
    const { viewer } = this;
    if (change.time !== undefined) {
      viewer.time = change.time;
      this._instant();
    } else {
      const last = viewer.shape.sections.s_mm.at(-1);
      const end = viewer.view.distal_s_mm ?? last;
      const beyond = change.s > 0.5 * (last + end);
      const k = viewer.nearestSection(change.s);
      this.mark(beyond ? { kind: 'distal' } : { kind: 'section', k });
    }
  }

  mark(mark) {
    this.viewer.mark = mark;
    this._marked();
  }

  _marked() {
    this.viewer.refresh();
    this.panels.drawWaves(this.viewer.reading());
    const { section, mark } = this.viewer;
    const slider = element('along');
    slider.value = mark.kind === 'distal' ? slider.max : (section ?? slider.value);
    this._instant();
  }

  _instant() {
    const { viewer } = this;
    viewer.refresh();
    const reading = viewer.reading();
    this.panels.update(reading);
    element('time').value = viewer.time;
    element('time-text').textContent = `${viewer.time.toFixed(3)} s of ${viewer.span.toFixed(3)} s`;
    element('time').setAttribute('aria-valuetext', `${viewer.time.toFixed(3)} seconds`);
    const s = reading.s === null ? 'outside of the artery' : `${reading.s.toFixed(1)} mm`;
    element('along').setAttribute('aria-valuetext', `${s}, Pd/Pa ${reading.ratio.toFixed(3)}`);
    this.changed = true;
  }

  /** Everything, after another view was chosen. */
  _whole() {
    const { viewer } = this;
    const { view } = viewer;
    element('time').max = viewer.span;
    element('time').step = viewer.span / 400;
    const { sections } = viewer.shape;
    element('along').max = sections ? sections.s_mm.length : 0;
    const ratio = view.ratio === null ? 'no whole cycle' : `${called(view)} ${view.ratio.toFixed(3)}`;
    const measured = view.measured === null ? '' : ` (measured ${view.measured.toFixed(3)})`;
    element('shown').textContent = `${this.words[viewer.number].condition}: ${ratio}${measured}`;
    element('exaggeration').disabled = !view.moved_mm;
    element('rigid-note').hidden = Boolean(view.moved_mm);
    this._colours();
    this._chosen();
    this.panels.draw();
    this._marked();
  }

  _colours() {
    const names = this.viewer.colourNames();
    for (const option of element('colour').options) {
      option.hidden = option.disabled = !names.includes(option.value);
    }
    element('colour').value = this.viewer.colour;
    const { scale } = this.viewer;
    drawScale(element('scale'), scale);
    element('scale-name').textContent = element('colour').selectedOptions[0].dataset.scale;
    const marks = ticks(scale.low, scale.high, 4);
    const step = marks[1] - marks[0];
    const digits = Math.max(0, -Math.floor(Math.log10(step) + 1e-9));
    const text = (value) => value.toFixed(Math.min(digits, 6)).replace('-', '−');
    const labels = marks.map((value) => [value, text(value), false]);
    if (scale.limit !== null) {
      const near = (value) => Math.abs(value - scale.limit) < 0.4 * step;
      labels.splice(0, labels.length, ...labels.filter(([value]) => !near(value)));
      labels.push([scale.limit, `${scale.limit.toFixed(2)} limit`, true]);
    }
    const spans = labels.map(([value, text, limit]) => {
      const span = document.createElement('span');
      span.textContent = text;
      span.className = limit ? 'limit' : '';
      span.style.bottom = `${(100 * (value - scale.low)) / (scale.high - scale.low)}%`;
      return span;
    });
    element('scale-ticks').replaceChildren(...spans);
  }

  /** One group of buttons for each way in which the views differ. */
  _choices() {
    for (const axis of AXES) {
      const stressed = (view) => Number(view.ratio_name === 'ffr');
      const ordered = [...this.words].sort((a, b) => stressed(a) - stressed(b));
      const values = [...new Set(ordered.map((view) => view[axis]))];
      const group = element(`choose-${axis}`);
      if (values.length === 1) {
        group.textContent = values[0];
        continue;
      }
      const buttons = values.map((value) => {
        const button = document.createElement('button');
        button.type = 'button';
        button.textContent = value;
        button.addEventListener('click', () => this.choose(axis, value));
        return button;
      });
      group.replaceChildren(...buttons);
    }
  }

  /** The view with this value, and the most else as it is. */
  choose(axis, value) {
    const now = this.words[this.viewer.number];
    const like = (view) => AXES.filter((a) => view[a] === now[a]).length;
    const among = this.words.flatMap((view, i) => (view[axis] === value ? [[like(view), i]] : []));
    this.viewer.show(among.reduce((best, one) => (one[0] > best[0] ? one : best))[1]);
    this._whole();
  }

  _chosen() {
    const now = this.words[this.viewer.number];
    for (const axis of AXES) {
      for (const button of element(`choose-${axis}`).children) {
        button.setAttribute('aria-pressed', String(button.textContent === now[axis]));
      }
    }
  }

  _controls() {
    const { viewer } = this;
    const on = (id, event, act) => element(id).addEventListener(event, act);
    on('time', 'input', () => {
      viewer.time = Number(element('time').value);
      this._instant();
    });
    on('along', 'input', () => {
      const k = Number(element('along').value);
      const distal = k >= Number(element('along').max);
      this.mark(distal ? { kind: 'distal' } : { kind: 'section', k });
    });
    on('exaggeration', 'change', () => {
      viewer.exaggeration = Number(element('exaggeration').value);
      this._instant();
    });
    on('colour', 'change', () => {
      viewer.colour = element('colour').value;
      viewer.rescale();
      this._colours();
      this._instant();
    });
    on('play', 'click', () => this.play(!this.playing));
    on('distal', 'click', () => this.mark({ kind: 'distal' }));
  }

  play(playing) {
    this.playing = playing;
    element('play').textContent = playing ? 'Pause' : 'Play';
  }

  _stageControls() {
    const canvas = element('stage');
    let down = null;
    canvas.addEventListener('pointerdown', (event) => {
      down = [event.clientX, event.clientY];
    });
    canvas.addEventListener('pointerup', (event) => {
      const far = down && Math.hypot(event.clientX - down[0], event.clientY - down[1]);
      if (down && far <= CLICK && event.button === 0) {
        const box = canvas.getBoundingClientRect();
        this.pick(event.clientX - box.left, event.clientY - box.top);
      }
      down = null;
    });
    const keys = {
      ArrowLeft: () => this.stage.turn(-TURN, 0),
      ArrowRight: () => this.stage.turn(TURN, 0),
      ArrowUp: () => this.stage.turn(0, TURN),
      ArrowDown: () => this.stage.turn(0, -TURN),
      '+': () => this.stage.turn(0, 0, 0.9),
      '-': () => this.stage.turn(0, 0, 1.1),
      Home: () => this.stage.resetView(),
      ' ': () => this.play(!this.playing),
    };
    canvas.addEventListener('keydown', (event) => {
      const act = keys[event.key];
      if (!act) return;
      event.preventDefault();
      act();
      this.changed = true;
    });
    element('reset').addEventListener('click', () => {
      this.stage.resetView();
      this.changed = true;
    });
  }

  /** Mark what lies at a place of the canvas. */
  pick(x, y) {
    if (this.viewer.pick(x, y)) this._marked();
  }

  _resize() {
    const box = element('stage-box');
    if (this.stage) this.stage.resize(box.clientWidth, box.clientHeight);
    if (!this.sized) this.stage?.resetView();
    this.sized = true;
    this.panels.draw();
    this._marked();
    this.draw(); // a canvas of another size is empty
  }

  draw() {
    this.stage?.render();
    this.changed = false;
  }

  _loop(now) {
    const passed = Math.min(100, now - (this.last ?? now)) / 1000;
    this.last = now;
    if (this.playing) {
      const { viewer } = this;
      viewer.time = (viewer.time + passed / SLOWED) % viewer.span;
      this._instant();
    }
    if (this.stage?.moves() || this.changed) this.draw();
    requestAnimationFrame((time) => this._loop(time));
  }
}

function stageOf() {
  try {
    return new Stage(element('stage'));
  } catch {
    document.body.classList.add('flat');
    return null;
  }
}

async function start() {
  const data = await unpackPage(json('vessel-data'));
  document.body.classList.add('live');
  const page = new Page(data, json('vessel-colours'), stageOf());
  if (location.hash === '#selftest') selfTest(page);
}

start().catch((error) => {
  document.body.classList.remove('live');
  document.body.classList.add('flat');
  element('trouble').textContent = `The interactive view could not start: ${error.message}.`;
});
