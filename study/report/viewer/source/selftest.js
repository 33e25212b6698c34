// `#selftest` behind the address of a page: what it draws and reads, as JSON in the page.

const FRAMES = 40;
const TRIED = 400;
const element = (id) => document.getElementById(id);

/** Share of the canvas that is not background, and how many colours there are. */
function inked(stage) {
  const { gl } = stage;
  stage.render();
  const [width, height] = [gl.drawingBufferWidth, gl.drawingBufferHeight];
  const pixels = new Uint8Array(4 * width * height);
  gl.readPixels(0, 0, width, height, gl.RGBA, gl.UNSIGNED_BYTE, pixels);
  const colours = new Set();
  let count = 0;
  for (let i = 0; i < pixels.length; i += 4) {
    const colour = (pixels[i] << 16) | (pixels[i + 1] << 8) | pixels[i + 2];
    colours.add(colour);
    if (colour !== 0xffffff) count++;
  }
  return { share: (4 * count) / pixels.length, colours: colours.size };
}

/** Set an input as a user does. */
function set(id, value, event = 'input') {
  element(id).value = value;
  element(id).dispatchEvent(new Event(event));
}

function shifted(page) {
  set('time', 0);
  const before = page.stage.array('position').slice();
  set('time', 0.35 * page.viewer.span);
  const after = page.stage.array('position');
  return before.reduce((most, value, i) => Math.max(most, Math.abs(value - after[i])), 0);
}

/** Clicks on nodes of the artery that can be seen. */
function picks(page) {
  const { viewer, stage } = page;
  const s = viewer.shape.node_s_mm;
  const chosen = Array.from(s.keys()).filter((node) => s[node] >= 0);
  const every = Math.max(1, Math.floor(chosen.length / TRIED));
  const found = [];
  for (const node of chosen.filter((_, i) => i % every === 0)) {
    const x = stage.array('position');
    const [left, top] = stage.project([x[3 * node], x[3 * node + 1], x[3 * node + 2]]);
    if (!viewer.pick(left, top)) continue;
    const { nodes, weights } = viewer.mark.point;
    const own = nodes.indexOf(node);
    if (own < 0 || weights[own] < 0.98) continue; // something else lies before it
    page.pick(left, top);
    const shown = Number(element('at-ratio').dataset.value);
    const { wider } = viewer.reading();
    const shownWider = element('at-wider').textContent;
    const text = element('at-ratio').textContent;
    found.push({ node, s: s[node], ratio: shown, text, wider, shownWider });
  }
  return found;
}

/** Time of an instant [ms]: computing it, and with the picture. */
function frameTimes(page) {
  const { gl } = page.stage;
  const pixel = new Uint8Array(4);
  const computing = [];
  const whole = [];
  for (let k = 0; k < FRAMES; k++) {
    const begun = performance.now();
    page.viewer.time = (k * page.viewer.span) / FRAMES;
    page._instant();
    computing.push(performance.now() - begun);
    page.draw();
    gl.readPixels(0, 0, 1, 1, gl.RGBA, gl.UNSIGNED_BYTE, pixel);
    whole.push(performance.now() - begun);
  }
  const median = (times) => times.sort((a, b) => a - b)[times.length >> 1];
  return { computing_ms: median(computing), frame_ms: median(whole) };
}

function tested(page) {
  const { viewer } = page;
  const views = viewer.page.views.map((view, number) => {
    viewer.show(number);
    page._whole();
    page.mark({ kind: 'distal' });
    const distal = Number(element('at-ratio').dataset.value);
    return { id: view.id, distal, shown: element('shown').textContent, picks: picks(page) };
  });
  const { sections } = viewer.shape;
  const along = sections && [0, sections.s_mm.length >> 1].map((k) => {
    set('along', k);
    return { k, ratio: Number(element('at-ratio').dataset.value), where: element('at-where').textContent };
  });
  const colours = viewer.colourNames().map((name) => {
    set('colour', name, 'change');
    const { low, high } = viewer.scale;
    const legend = element('scale-name').textContent;
    return { name, low, high, legend, ...inked(page.stage) };
  });
  set('colour', 'ratio', 'change');
  const { clientWidth: width, clientHeight: height } = page.stage.canvas;
  const shift = shifted(page);
  set('exaggeration', '10', 'change');
  const exaggerated = shifted(page);
  set('exaggeration', '1', 'change');
  const triangles = viewer.shape.triangles.length / 3;
  return { views, along, colours, shift, exaggerated, triangles, width, height, ...frameTimes(page) };
}

/** Leave the findings in the page. */
export function selfTest(page) {
  const place = document.createElement('script');
  place.type = 'application/json';
  place.id = 'selftest';
  try {
    place.textContent = JSON.stringify(page.stage ? tested(page) : { error: 'no WebGL 2' });
  } catch (error) {
    place.textContent = JSON.stringify({ error: String(error.stack) });
  }
  document.body.append(place);
}
