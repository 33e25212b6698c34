// The lumen on the graphics card: one surface coloured by one value, a ring and a point as marks.

import { Camera, Geometry, Mesh, Orbit, Program, Raycast, Renderer, Sphere, Texture } from 'ogl';
import { Transform, Vec2, Vec3 } from 'ogl';

const FIELD_OF_VIEW = 30; // degrees
const RING_SIDES = 8;
const RING_RADIUS = 0.14; // mm
const POINT_RADIUS = 0.38; // mm

const SURFACE_VERTEX = `#version 300 es
in vec3 position; in vec3 normal; in float value; in float pale;
uniform mat4 modelViewMatrix; uniform mat4 projectionMatrix; uniform mat3 normalMatrix;
out vec3 vNormal; out vec3 vPlace; out float vValue; out float vPale;
void main() {
  vec4 place = modelViewMatrix * vec4(position, 1.0);
  vNormal = normalMatrix * normal; vPlace = place.xyz; vValue = value; vPale = pale;
  gl_Position = projectionMatrix * place;
}`;

const SURFACE_FRAGMENT = `#version 300 es
precision highp float;
in vec3 vNormal; in vec3 vPlace; in float vValue; in float vPale;
uniform sampler2D tScale; uniform vec2 uRange; uniform float uLimit; uniform float uLimited;
uniform float uPaled;
out vec4 colour;
void main() {
  float share = clamp((vValue - uRange.x) / (uRange.y - uRange.x), 0.001, 0.999);
  vec3 base = mix(texture(tScale, vec2(share, 0.5)).rgb, vec3(0.93, 0.94, 0.95), 0.72 * vPale * uPaled);
  float line = abs(vValue - uLimit) / max(fwidth(vValue), 1e-9);
  base = mix(base, vec3(0.05), uLimited * (1.0 - vPale) * (1.0 - smoothstep(0.8, 1.8, line)));
  float facing = abs(dot(normalize(vNormal), normalize(-vPlace)));
  colour = vec4(base * (0.5 + 0.5 * facing), 1.0);
}`;

const MARK_VERTEX = `#version 300 es
in vec3 position; uniform mat4 modelViewMatrix; uniform mat4 projectionMatrix;
void main() { gl_Position = projectionMatrix * modelViewMatrix * vec4(position, 1.0); }`;

const MARK_FRAGMENT = `#version 300 es
precision highp float; uniform vec3 uColour; out vec4 colour;
void main() { colour = vec4(uColour, 1.0); }`;

const UNITS = Array.from({ length: RING_SIDES }, (_, k) => {
  const angle = (2 * Math.PI * k) / RING_SIDES;
  return [Math.cos(angle), Math.sin(angle)];
});

export class Stage {
  /** Throws where the browser has no WebGL 2. */
  constructor(canvas) {
    this.canvas = canvas;
    this.renderer = new Renderer({ canvas, antialias: true, dpr: Math.min(2, devicePixelRatio) });
    if (!this.renderer.isWebgl2) throw new Error('no WebGL 2');
    const gl = (this.gl = this.renderer.gl);
    gl.clearColor(1, 1, 1, 1);
    this.camera = new Camera(gl, { fov: FIELD_OF_VIEW, near: 1, far: 1000 });
    this.orbit = new Orbit(this.camera, { element: canvas, ease: 0.35, inertia: 0.7 });
    this.raycast = new Raycast();
    this.scene = new Transform();
    this.texture = new Texture(gl, {
      width: 256,
      height: 1,
      generateMipmaps: false,
      minFilter: gl.NEAREST,
      magFilter: gl.NEAREST,
      flipY: false,
    });
    this.program = new Program(gl, {
      vertex: SURFACE_VERTEX,
      fragment: SURFACE_FRAGMENT,
      cullFace: false,
      uniforms: {
        tScale: { value: this.texture },
        uRange: { value: new Vec2(0, 1) },
        uLimit: { value: 0 },
        uLimited: { value: 0 },
        uPaled: { value: 0 },
      },
    });
    const mark = { vertex: MARK_VERTEX, fragment: MARK_FRAGMENT, cullFace: false };
    this.marks = new Program(gl, { ...mark, uniforms: { uColour: { value: [0.08, 0.09, 0.11] } } });
    const sphere = new Sphere(gl, { radius: POINT_RADIUS, widthSegments: 20 });
    this.point = new Mesh(gl, { geometry: sphere, program: this.marks });
    this.point.setParent(this.scene);
    this.point.visible = false;
  }

  /** Show another lumen; the eye stays where it is, but for the first. */
  setShape(shape) {
    const { gl } = this;
    const nodes = shape.points_mm.length / 3;
    const moving = (size) => ({ size, data: new Float32Array(size * nodes), usage: gl.DYNAMIC_DRAW });
    const pale = Float32Array.from(shape.node_s_mm, (s) => (s < 0 ? 1 : 0));
    if (!pale.includes(0)) pale.fill(0);
    const geometry = new Geometry(gl, {
      position: moving(3),
      normal: moving(3),
      value: moving(1),
      pale: { size: 1, data: pale },
      index: { data: shape.triangles },
    });
    this._replace('surface', geometry, this.program);
    const most = Math.max(3, ...(shape.sections ? shape.sections.ring_sizes : []));
    this._replace('ring', this._ringGeometry(most), this.marks);
    this.ring.visible = false;
    const first = !this.shape;
    this.shape = shape;
    if (first) this.resetView();
  }

  _replace(name, geometry, program) {
    if (this[name]) {
      this[name].setParent(null);
      this[name].geometry.remove();
    }
    this[name] = new Mesh(this.gl, { geometry, program, frustumCulled: false });
    this[name].setParent(this.scene);
  }

  _ringGeometry(most) {
    const index = [];
    for (let i = 0; i < most * RING_SIDES; i++) {
      const next = i - (i % RING_SIDES) + ((i + 1) % RING_SIDES);
      index.push(i, next, i + RING_SIDES, next, next + RING_SIDES, i + RING_SIDES);
    }
    const data = new Float32Array(3 * (most + 1) * RING_SIDES);
    return new Geometry(this.gl, {
      position: { size: 3, data, usage: this.gl.DYNAMIC_DRAW },
      index: { data: new Uint16Array(index) },
    });
  }

  /** Take over what was written into the surface's arrays. */
  touch(...names) {
    for (const name of names) this.surface.geometry.attributes[name].needsUpdate = true;
  }

  array(name) {
    return this.surface.geometry.attributes[name].data;
  }

  /** Colours of the surface; `paled`: fainter on other vessels than the artery. */
  setScale(scale, paled) {
    this.program.uniforms.uPaled.value = paled ? 1 : 0;
    this.texture.image = scale.bytes;
    this.texture.needsUpdate = true;
    this.program.uniforms.uRange.value.set(scale.low, scale.high);
    this.program.uniforms.uLimit.value = scale.limit ?? 0;
    this.program.uniforms.uLimited.value = scale.limit === null ? 0 : 1;
  }

  /** A tube through the points of a ring; null hides it. */
  setRing(points) {
    this.ring.visible = Boolean(points);
    if (!points) return;
    const n = points.length;
    const middle = [0, 1, 2].map((k) => points.reduce((sum, p) => sum + p[k], 0) / n);
    const normal = new Vec3();
    points.forEach((p, i) => {
      const [a, b] = [new Vec3(...p).sub(middle), new Vec3(...points[(i + 1) % n]).sub(middle)];
      normal.add(a.cross(b));
    });
    normal.normalize();
    const { position } = this.ring.geometry.attributes;
    for (let i = 0; i <= n; i++) {
      const p = points[i % n];
      const out = new Vec3(...p).sub(middle).normalize();
      UNITS.forEach(([c, s], k) => {
        const at = 3 * (i * RING_SIDES + k);
        for (let j = 0; j < 3; j++) {
          position.data[at + j] = p[j] + RING_RADIUS * ((1 + c) * out[j] + s * normal[j]);
        }
      });
    }
    position.needsUpdate = true;
    this.ring.geometry.setDrawRange(0, 6 * RING_SIDES * n);
  }

  setPoint(place) {
    this.point.visible = Boolean(place);
    if (place) this.point.position.set(...place);
  }

  resetView() {
    const { focus_mm: focus, toward, up, half_mm: half } = this.shape;
    const { clientWidth, clientHeight } = this.canvas;
    const aspect = clientWidth / Math.max(1, clientHeight);
    const reach = half / Math.tan((FIELD_OF_VIEW * Math.PI) / 360) / Math.min(1, aspect);
    this.camera.up.set(...up);
    this.camera.position.set(...focus.map((value, i) => value + reach * toward[i]));
    this.orbit.target.set(...focus);
    this.orbit.minDistance = 0.15 * reach;
    this.orbit.maxDistance = 6 * reach;
    this.orbit.forcePosition();
    this.camera.lookAt(this.orbit.target);
  }

  /** Move the eye round what it looks at [rad], or nearer. */
  turn(across, upwards, nearer = 1) {
    const { target } = this.orbit;
    const offset = new Vec3().copy(this.camera.position).sub(target);
    const spread = offset.len();
    const up = this.camera.up;
    const side = new Vec3().copy(up).cross(offset).normalize();
    const high = new Vec3().copy(offset).cross(side).normalize();
    offset.add(side.scale(spread * Math.tan(across))).add(high.scale(spread * Math.tan(upwards)));
    offset.normalize().scale(spread * nearer);
    this.camera.position.copy(target).add(offset);
    this.orbit.forcePosition();
  }

  resize(width, height) {
    this.renderer.setSize(width, height);
    this.camera.perspective({ aspect: width / height });
  }

  /** Whether the eye still moves. */
  moves() {
    const before = this.camera.position.slice();
    this.orbit.update();
    return this.camera.position.some((value, i) => Math.abs(value - before[i]) > 1e-4);
  }

  render() {
    this.renderer.render({ scene: this.scene, camera: this.camera });
  }

  /** Origin and direction of the ray through a place of the canvas [CSS pixels]. */
  ray(x, y) {
    const { clientWidth, clientHeight } = this.canvas;
    this.camera.updateMatrixWorld();
    this.raycast.castMouse(this.camera, [(2 * x) / clientWidth - 1, 1 - (2 * y) / clientHeight]);
    return [this.raycast.origin, this.raycast.direction];
  }

  /** Where a point appears in the canvas [CSS pixels]. */
  project(place) {
    this.camera.updateMatrixWorld();
    const p = new Vec3(...place);
    this.camera.project(p);
    const { clientWidth, clientHeight } = this.canvas;
    return [((p.x + 1) * clientWidth) / 2, ((1 - p.y) * clientHeight) / 2];
  }
}
