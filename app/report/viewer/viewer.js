// The 3D view of the report: the machine at rest, under a force at a point, and swinging in its natural modes.
// Built into viewer.bundle.js by `npm ci && npm run build` in this folder; everything it shows comes from the page itself.
import {
  AmbientLight, BackSide, BufferAttribute, BufferGeometry, Color, ConeGeometry, CylinderGeometry, DecrementWrapStencilOp,
  DirectionalLight, DoubleSide, FrontSide, Group, HemisphereLight, IncrementWrapStencilOp, LineBasicMaterial, LineSegments, Matrix4,
  Mesh, MeshBasicMaterial, MeshStandardMaterial, NotEqualStencilFunc, OctahedronGeometry, OrthographicCamera, PerspectiveCamera, Plane,
  PlaneGeometry, Quaternion, Raycaster, Scene, SphereGeometry, Vector2, Vector3, WebGLRenderer, WebGLRenderTarget, ZeroStencilOp,
} from "three";
import { OrbitControls } from "three/addons/controls/OrbitControls.js";

const RAMP = ["#31459b", "#3e8fc4", "#7fcdbb", "#fee08b", "#f46d43", "#c51b3d"];
const VIEWS = { iso: [1.25, -1.0, 0.75], front: [1, 0, 0], side: [0, -1, 0], top: [0.0001, 0, 1] };
const KINDS = { rigid: "#64748b", spring: "#d97706", free: "#7c3aed" };
const FREE_KINDS = new Set(["revolute", "universal", "spherical", "prismatic"]);
const SWING_SHARE = 0.06;
const PERIOD = 1.6;
const THUMB = [216, 162];
// the half towards the usual viewer goes
const CUTS = { x: [-1, 0, 0], y: [0, 1, 0], z: [0, 0, -1] };
const ARROW = 0.16;
const NARROW = 560;
const FIELDS = { component: 0, displacement: 1, energy: 2 };
// where a label may stand from its mark, in widths and heights of itself and pixels; the first free place is taken
const PLACES = [[0, -0.5, 9, 0], [-1, -0.5, -9, 0], [-0.5, -1, 0, -9], [-0.5, 0, 0, 9], [0, -1, 6, -6], [0, 0, 6, 6], [-1, -1, -6, -6], [-1, 0, -6, 6],
  [-0.5, -2.2, 0, -9], [-0.5, 1.2, 0, 9], [0, -2, 12, -9], [0, 1, 12, 9]];

const byId = (id) => document.getElementById(id);
const make = (tag, className, text) => {
  const element = document.createElement(tag);
  if (className) element.className = className;
  if (text !== undefined) element.textContent = text;
  return element;
};

async function unpack(text) {
  const bytes = Uint8Array.from(atob(text), (c) => c.charCodeAt(0));
  const stream = new Blob([bytes]).stream().pipeThrough(new DecompressionStream("deflate"));
  return new Response(stream).arrayBuffer();
}

// reads columns of whole numbers one after the other: of each number the difference from the one before, lowest bytes of all first
function reader(buffer) {
  const bytes = new Uint8Array(buffer);
  let place = 0;
  return (Type, rows, columns) => {
    const count = rows * columns;
    const found = new Type(count);
    for (let c = 0, k = 0; c < columns; c++) {
      for (let i = 0, value = 0; i < rows; i++, k++) {
        let step = 0;
        for (let b = 0; b < Type.BYTES_PER_ELEMENT; b++) step |= bytes[place + b * count + k] << (8 * b);
        value = (value + step) | 0;
        found[i * columns + c] = value;
      }
    }
    place += count * Type.BYTES_PER_ELEMENT;
    return found;
  };
}

function readComponents(data, read) {
  return data.components.map((about) => {
    const raw = read(Uint16Array, about.points, 3);
    const points = new Float32Array(raw.length);
    for (let i = 0; i < raw.length; i++) points[i] = about.low[i % 3] + raw[i] * about.step[i % 3];
    return { ...about, position: points, faces: read(Uint32Array, about.triangles, 3), lines: read(Uint32Array, about.edges, 2) };
  });
}

// pose by pose a map from the id of a shape to what is known of it, with a displacement per body (typed numbers, or six for one that
// moves rigidly) and the energy density at its points, where it is known
function readShapes(data, components, read) {
  const Type = data.bytes === 2 ? Int16Array : Int8Array;
  return data.poses.map((pose) => new Map(pose.shapes.map((about) => [about.id, {
    ...about,
    parts: components.map((c, i) => about.rigid[i] ?? read(Type, c.points, 3)),
    energies: components.map((c, i) => (about.resolved[i] ? read(Uint8Array, c.points, 1) : null)),
  }])));
}

// a rigid fit may pass the largest displacement by a little
const FULL = 32600;

// displacement a + r x p in machine axes of every point p of a body, as 16-bit shares of the largest one
function moveRigidly([ax, ay, az, rx, ry, rz], f, position) {
  const moved = new Int16Array(position.length);
  for (let k = 0; k < position.length; k += 3) {
    const [u, v, w] = [position[k], position[k + 1], position[k + 2]];
    const x = f[0] + f[3] * u + f[4] * v + f[5] * w;
    const y = f[1] + f[6] * u + f[7] * v + f[8] * w;
    const z = f[2] + f[9] * u + f[10] * v + f[11] * w;
    moved[k] = FULL * (ax + ry * z - rz * y);
    moved[k + 1] = FULL * (ay + rz * x - rx * z);
    moved[k + 2] = FULL * (az + rx * y - ry * x);
  }
  return moved;
}

const ramp = `
vec3 ramp(float s) {
  ${RAMP.map((c, i) => { const k = new Color(c); return `const vec3 c${i} = vec3(${k.r.toFixed(4)}, ${k.g.toFixed(4)}, ${k.b.toFixed(4)});`; }).join("\n  ")}
  float t = clamp(s, 0.0, 1.0) * ${(RAMP.length - 1).toFixed(1)};
  vec3 found = c0;
  ${RAMP.slice(1).map((_, i) => `found = mix(found, c${i + 1}, clamp(t - ${i.toFixed(1)}, 0.0, 1.0));`).join("\n  ")}
  return found;
}`;

// adds the displacement, given in machine axes, behind the placement of the body; field 1 colours by displacement, 2 by energy density
function shifted(material, shared, tinted, resolved) {
  material.onBeforeCompile = (shader) => {
    Object.assign(shader.uniforms, shared, { resolved });
    shader.vertexShader = shader.vertexShader
      .replace("#include <common>", "#include <common>\nattribute vec3 shift;\nattribute float energy;\nuniform float swing;\nuniform float field;\nvarying float vShare;")
      .replace("#include <project_vertex>", `
        vShare = field > 1.5 ? energy : length(shift);
        vec4 placed = modelMatrix * vec4(transformed, 1.0);
        placed.xyz += swing * shift;
        vec4 mvPosition = viewMatrix * placed;
        gl_Position = projectionMatrix * mvPosition;`);
    if (!tinted) return;
    shader.fragmentShader = shader.fragmentShader
      .replace("#include <common>", `#include <common>\nuniform float field;\nuniform float resolved;\nvarying float vShare;\n${ramp}`)
      .replace("#include <color_fragment>", `#include <color_fragment>
        if (field > 1.5 && resolved < 0.5) diffuseColor.rgb = vec3(0.62, 0.65, 0.69);
        else if (field > 0.5) diffuseColor.rgb = ramp(vShare);`);
  };
  material.customProgramCacheKey = () => (tinted ? "shifted tinted" : "shifted");
  return material;
}

// what is cut is hatched, in the colour of the body
function hatched(material) {
  material.onBeforeCompile = (shader) => {
    shader.fragmentShader = shader.fragmentShader.replace("#include <opaque_fragment>", `#include <opaque_fragment>
      gl_FragColor.rgb *= 1.0 - 0.45 * smoothstep(0.7, 0.8, fract((gl_FragCoord.x + gl_FragCoord.y) / 14.0));`);
  };
  return material;
}

class Viewer {
  constructor(data, components, shapes) {
    Object.assign(this, { data, components, shapes, pose: 0, shape: null, playing: false, phase: 0.25, dirty: true });
    this.size = data.size;
    this.shared = { swing: { value: 0 }, field: { value: 0 } };
    this.plane = new Plane();
    this.planes = [];
    this.scene = new Scene();
    this.stage = byId("stage");
    this.renderer = new WebGLRenderer({ antialias: true, alpha: true, stencil: true });
    this.renderer.localClippingEnabled = true;
    this.renderer.setPixelRatio(Math.min(window.devicePixelRatio || 1, 2));
    this.stage.append(this.renderer.domElement);
    this.camera = new PerspectiveCamera(28, 1, this.size / 200, this.size * 50);
    this.camera.up.set(0, 0, 1);
    this.controls = new OrbitControls(this.camera, this.renderer.domElement);
    this.controls.enableDamping = true;
    this.controls.dampingFactor = 0.12;
    // the wheel scrolls the page until the picture was touched
    this.controls.enableZoom = false;
    this.stage.addEventListener("pointerdown", () => { this.controls.enableZoom = true; });
    this.stage.addEventListener("pointerleave", (event) => { if (!event.buttons) this.controls.enableZoom = false; });
    this.controls.addEventListener("change", () => { this.dirty = true; });
    this.addLights();
    this.addBodies();
    this.marks = new Group();
    this.scene.add(this.marks);
    this.arrows = new Group();
    this.scene.add(this.arrows);
    this.labels = byId("labels");
    this.placePose(0);
    this.look("iso");
  }

  addLights() {
    this.scene.add(new HemisphereLight("#ffffff", "#8b93a1", 1.5), new AmbientLight("#ffffff", 0.55));
    this.headlight = new Group();
    for (const [x, y, z, strength] of [[0.5, 0.9, 1, 1.7], [-1, 0.2, 0.5, 0.5]]) {
      const light = new DirectionalLight("#ffffff", strength);
      light.position.set(x, y, z);
      this.headlight.add(light, light.target);
    }
    this.scene.add(this.headlight);
  }

  addBodies() {
    this.bodies = this.components.map((component) => {
      const position = new BufferAttribute(component.position, 3);
      const rest = new BufferAttribute(new Int8Array(3 * component.points), 3, true);
      const calm = new BufferAttribute(new Uint8Array(component.points), 1, true);
      const geometry = (index) => new BufferGeometry().setAttribute("position", position).setAttribute("shift", rest)
        .setAttribute("energy", calm).setIndex(new BufferAttribute(index, 1));
      const [face, line] = [geometry(component.faces), geometry(component.lines)];
      const resolved = { value: 0 };
      const surface = { color: component.color, flatShading: true, roughness: 0.62, metalness: 0.05 };
      const offset = { polygonOffset: true, polygonOffsetFactor: 1.2, polygonOffsetUnits: 1.2 };
      const mesh = new Mesh(face, shifted(new MeshStandardMaterial({ ...surface, ...offset }), this.shared, true, resolved));
      const edges = new LineSegments(line, shifted(new LineBasicMaterial({ color: "#131a24", transparent: true, opacity: 0.75 }), this.shared));
      const ghost = new LineSegments(line, new LineBasicMaterial({ color: "#7b8694", transparent: true, opacity: 0.4, depthWrite: false }));
      ghost.renderOrder = -1;
      ghost.visible = false;
      const group = new Group();
      group.add(mesh, edges, ghost);
      group.matrixAutoUpdate = false;
      for (const part of [mesh, edges, ghost]) part.frustumCulled = false;
      this.scene.add(group);
      return { component, group, mesh, edges, ghost, geometries: [face, line], geometry, rest, calm, resolved, web: null, visible: true };
    });
  }

  // the triangles as they are drawn
  showWeb(wanted) {
    for (const body of this.bodies) {
      if (wanted && !body.web) {
        const { faces, points } = body.component;
        const sides = new Map();
        for (let k = 0; k < faces.length; k += 3) for (const [a, b] of [[0, 1], [1, 2], [2, 0]]) {
          const [low, high] = [Math.min(faces[k + a], faces[k + b]), Math.max(faces[k + a], faces[k + b])];
          sides.set(low * points + high, [low, high]);
        }
        const lines = body.geometry(Uint32Array.from([...sides.values()].flat()));
        body.web = new LineSegments(lines, shifted(new LineBasicMaterial({ color: "#131a24", transparent: true, opacity: 0.3 }), this.shared));
        body.web.material.clippingPlanes = [...this.planes];
        body.web.frustumCulled = false;
        body.geometries.push(lines);
        for (const name of ["shift", "energy"]) lines.setAttribute(name, body.geometries[0].getAttribute(name));
        body.group.add(body.web);
      }
      if (body.web) body.web.visible = wanted;
    }
    this.dirty = true;
  }

  // cuts the machine across an axis, at a share of its size, or not at all
  cutAcross(axis, share, turned) {
    this.planes.length = 0;
    if (axis) {
      const [low, high] = this.data.box["xyz".indexOf(axis)];
      const normal = new Vector3().fromArray(CUTS[axis]).multiplyScalar(turned ? -1 : 1);
      const at = low + share * (high - low);
      this.plane.set(normal, -normal.getComponent("xyz".indexOf(axis)) * at);
      this.planes.push(this.plane);
    }
    for (const body of this.bodies) {
      body.caps ??= this.addCaps(body);
      for (const part of [body.mesh, body.edges, body.ghost, body.web, ...body.caps.counts]) {
        if (!part) continue;
        part.material.clippingPlanes = [...this.planes];
        part.material.needsUpdate = true;
      }
      for (const count of body.caps.counts) count.visible = Boolean(axis);
      body.caps.lid.quaternion.setFromUnitVectors(new Vector3(0, 0, 1), this.plane.normal.clone().negate());
      this.plane.coplanarPoint(body.caps.lid.position).add(this.middle().projectOnPlane(this.plane.normal));
    }
    this.dirty = true;
  }

  // a lid on what is cut open: drawn where more back than front faces are seen behind the plane
  addCaps(body) {
    const order = 1 + this.bodies.indexOf(body);
    const counts = [[BackSide, IncrementWrapStencilOp], [FrontSide, DecrementWrapStencilOp]].map(([side, step]) => {
      const material = new MeshBasicMaterial({ side, depthTest: false, depthWrite: false, colorWrite: false, stencilWrite: true, stencilFail: step, stencilZFail: step, stencilZPass: step });
      const count = new Mesh(body.geometries[0], shifted(material, this.shared));
      count.renderOrder = order;
      count.frustumCulled = false;
      body.group.add(count);
      return count;
    });
    const surface = new MeshBasicMaterial({ color: body.component.color, side: DoubleSide, stencilWrite: true, stencilFunc: NotEqualStencilFunc, stencilZPass: ZeroStencilOp, stencilZFail: ZeroStencilOp, stencilFail: ZeroStencilOp });
    const lid = new Mesh(new PlaneGeometry(4 * this.size, 4 * this.size), hatched(surface));
    lid.renderOrder = order + 0.5;
    lid.onAfterRender = () => this.renderer.clearStencil();
    this.scene.add(lid);
    return { counts, lid };
  }

  middle() { return new Vector3().fromArray(this.data.box.map(([low, high]) => 0.5 * (low + high))); }

  placePose(number) {
    this.pose = number;
    const pose = this.data.poses[number];
    this.bodies.forEach((body, i) => {
      const f = pose.frames[i];
      body.group.matrix.copy(new Matrix4().set(f[3], f[4], f[5], f[0], f[6], f[7], f[8], f[1], f[9], f[10], f[11], f[2], 0, 0, 0, 1));
      body.group.matrixWorldNeedsUpdate = true;
    });
    this.placeMarks(pose);
    this.showShape(this.shape && this.shapes[number].has(this.shape) ? this.shape : null);
  }

  placeMarks(pose) {
    for (const mark of this.marks.children) { mark.geometry.dispose(); mark.material.dispose(); }
    this.marks.clear();
    const place = (geometry, color, about, text) => {
      const mark = new Mesh(geometry, new MeshBasicMaterial({ color, depthTest: false, transparent: true, opacity: 0.9 }));
      mark.renderOrder = 5;
      mark.userData = { name: about.name, text, rest: new Vector3().fromArray(about.at), anchor: this.anchor(about.body, about.at) };
      this.marks.add(mark);
      return mark;
    };
    for (const joint of pose.joints) {
      const kind = joint.kind === "rigid" ? "rigid" : FREE_KINDS.has(joint.kind) ? "free" : "spring";
      place(new OctahedronGeometry(0.0085 * this.size), KINDS[kind], joint, `${joint.name}: ${joint.kind.replaceAll("_", " ")}, ${joint.first} – ${joint.second}`);
    }
    this.tags = pose.points.map((point) => {
      const ball = place(new SphereGeometry(0.011 * this.size, 20, 14), "#d11a3a", point, `${point.name}: ${point.tool} relative to ${point.work}`);
      ball.renderOrder = 6;
      return [ball, make("span", "tag", point.name)];
    });
  }

  // the point of a body that is nearest to a place in the machine: marks and arrows move with it
  anchor(body, place) {
    if (body === null) return null;
    const { position } = this.components[body];
    const local = new Vector3().fromArray(place).applyMatrix4(this.bodies[body].group.matrix.clone().invert());
    let [nearest, least] = [0, Infinity];
    for (let k = 0; k < position.length; k += 3) {
      const distance = (position[k] - local.x) ** 2 + (position[k + 1] - local.y) ** 2 + (position[k + 2] - local.z) ** 2;
      if (distance < least) [nearest, least] = [k / 3, distance];
    }
    return { body, nearest, place };
  }

  // displacement of an anchor as a share of the largest one: exact on a body that moves rigidly
  movement(anchor) {
    const found = new Vector3();
    if (!anchor || this.shape === null) return found;
    const rigid = this.about().rigid[anchor.body];
    if (rigid) {
      const turn = new Vector3(...rigid.slice(3));
      return found.fromArray(rigid).add(turn.cross(new Vector3(...anchor.place)));
    }
    const shift = this.bodies[anchor.body].geometries[0].getAttribute("shift");
    return found.fromBufferAttribute(shift, anchor.nearest);
  }

  // the force of a static case where it acts on the tool, and its opposite on the work
  placeArrows() {
    for (const arrow of this.arrows.children) for (const part of arrow.children) { part.geometry.dispose(); part.material.dispose(); }
    this.arrows.clear();
    this.forceTags = [];
    const about = this.shape === null ? null : this.about();
    if (about?.kind !== "force") return;
    const [name, axis] = [about.id.slice(5, -2), about.id.at(-1)];
    const point = this.data.poses[this.pose].points.find((other) => other.name === name);
    if (!point) return;
    const direction = new Vector3().setComponent("xyz".indexOf(axis), 1);
    const add = (at, body, sign, color) => {
      const length = ARROW * this.size;
      const arrow = new Group();
      const part = (geometry, middle) => {
        const mesh = new Mesh(geometry.translate(0, middle, 0), new MeshBasicMaterial({ color, depthTest: false, transparent: true, opacity: 0.95 }));
        mesh.renderOrder = 7;
        arrow.add(mesh);
      };
      part(new CylinderGeometry(0.04 * length, 0.04 * length, 0.74 * length, 16), 0.37 * length);
      part(new ConeGeometry(0.11 * length, 0.28 * length, 24), 0.86 * length);
      arrow.quaternion.copy(new Quaternion().setFromUnitVectors(new Vector3(0, 1, 0), direction.clone().multiplyScalar(sign)));
      arrow.userData = { rest: new Vector3().fromArray(at), anchor: this.anchor(body, at), head: direction.clone().multiplyScalar(sign * length) };
      this.arrows.add(arrow);
      const label = make("span", "tag force", "1 kN");
      this.forceTags.push([arrow, label]);
    };
    add(point.at, point.body, 1, "#b1122f");
    if (point.back && point.back_body !== null) add(point.back, point.back_body, -1, "#8a5a66");
  }

  about(pose = this.pose, id = this.shape) { return this.shapes[pose].get(id); }

  partsOf(pose, id) {
    const { parts } = this.about(pose, id);
    parts.forEach((part, i) => {
      if (Array.isArray(part)) parts[i] = moveRigidly(part, this.data.poses[pose].frames[i], this.components[i].position);
    });
    return parts;
  }

  showShape(id) {
    this.shape = id;
    const parts = id === null ? null : this.partsOf(this.pose, id);
    const energies = id === null ? [] : this.about().energies;
    this.bodies.forEach((body, i) => {
      const shift = parts ? new BufferAttribute(parts[i], 3, true) : body.rest;
      const energy = energies[i] ? new BufferAttribute(energies[i], 1, true) : body.calm;
      for (const geometry of body.geometries) geometry.setAttribute("shift", shift).setAttribute("energy", energy);
      body.resolved.value = energies[i] ? 1 : 0;
      body.ghost.visible = parts !== null && byId("show-rest").checked;
    });
    this.placeArrows();
    this.marks.visible = byId("show-joints").checked;
    this.labels.replaceChildren(...[...(this.marks.visible ? this.tags : []), ...this.forceTags].map(([, label]) => label));
    this.shared.field.value = parts ? FIELDS[this.field()] : 0;
    this.phase = 0.25;
    this.dirty = true;
    showLegend(this);
  }

  // what the colours show: energy densities only where there are some
  field() {
    const wanted = byId("colour").value;
    return wanted === "energy" && !(this.shape !== null && this.about().peak > 0) ? "displacement" : wanted;
  }

  look(name) {
    const center = this.middle();
    const direction = new Vector3().fromArray(VIEWS[name]).normalize();
    const right = new Vector3(0, 0, 1).cross(direction).normalize();
    const up = direction.clone().cross(right);
    const slope = Math.tan((this.camera.fov * Math.PI) / 360);
    let distance = 0;
    for (const corner of this.corners(center)) {
      const wide = Math.max(Math.abs(corner.dot(up)), Math.abs(corner.dot(right)) / this.camera.aspect);
      distance = Math.max(distance, wide / slope + corner.dot(direction));
    }
    this.controls.target.copy(center);
    this.camera.position.copy(center).addScaledVector(direction, (this.stage.clientWidth < NARROW ? 1.2 : 1.06) * distance);
    this.controls.update();
    this.dirty = true;
  }

  // corners of the box around each body, from a centre
  corners(center) {
    return this.bodies.flatMap(({ component, group }) => {
      const { low, step } = component;
      const found = [];
      for (const x of [0, 65535]) for (const y of [0, 65535]) for (const z of [0, 65535]) {
        found.push(new Vector3(low[0] + x * step[0], low[1] + y * step[1], low[2] + z * step[2]).applyMatrix4(group.matrix).sub(center));
      }
      return found;
    });
  }

  resize() {
    const { clientWidth: width, clientHeight: height } = this.stage;
    if (!width || !height) return;
    this.camera.aspect = width / height;
    // where the legend is as wide as the picture the machine stands above it
    if (width < NARROW) this.camera.setViewOffset(width, height, 0, 30, width, height);
    else this.camera.clearViewOffset();
    this.camera.updateProjectionMatrix();
    this.renderer.setSize(width, height);
    this.dirty = true;
  }

  get amplitude() { return SWING_SHARE * this.size * Number(byId("amplitude").value); }

  frame(seconds) {
    if (!this.seen) return;
    if (this.playing && this.shape !== null) { this.phase = (this.phase + seconds / PERIOD) % 1; this.dirty = true; }
    this.controls.update();
    if (!this.dirty) return;
    this.dirty = false;
    this.draw();
  }

  draw() {
    this.shared.swing.value = this.shape === null ? 0 : this.amplitude * Math.sin(2 * Math.PI * this.phase);
    for (const mark of [...this.marks.children, ...this.arrows.children]) {
      mark.position.copy(mark.userData.rest).addScaledVector(this.movement(mark.userData.anchor), this.shared.swing.value);
      mark.visible = this.isLeft(mark.position);
    }
    this.headlight.quaternion.copy(this.camera.quaternion);
    this.headlight.updateMatrixWorld(true);
    for (const body of this.bodies) if (body.caps) body.caps.lid.visible = body.visible && this.planes.length > 0;
    this.renderer.render(this.scene, this.camera);
    this.placeLabels();
    drawTriad(this.camera);
  }

  // not on the side that was cut away
  isLeft(place) { return this.planes.length === 0 || this.plane.distanceToPoint(place) >= 0; }

  // each label beside its mark where none stands yet; without a free place it is left to the tooltip of the mark
  placeLabels() {
    const { clientWidth: width, clientHeight: height } = this.stage;
    const frame = this.stage.getBoundingClientRect();
    const taken = [...document.querySelectorAll(".stage-frame > .corner, #legend:not([hidden]), #caption")].map((element) => {
      const box = element.getBoundingClientRect();
      return [box.left - frame.left, box.top - frame.top, box.right - frame.left, box.bottom - frame.top];
    });
    for (const [mark, label] of [...this.forceTags, ...(this.marks.visible ? this.tags : [])]) {
      const at = mark.position.clone().add(mark.userData.head ?? new Vector3()).project(this.camera);
      const [x, y] = [0.5 * (at.x + 1) * width, 0.5 * (1 - at.y) * height];
      const [w, h] = [label.offsetWidth, label.offsetHeight];
      const free = PLACES.map(([u, v, dx, dy]) => [x + u * w + dx, y + v * h + dy]).find(([left, top]) =>
        left >= 0 && top >= 0 && left + w <= width && top + h <= height &&
        taken.every(([l, t, r, b]) => left >= r || left + w <= l || top >= b || top + h <= t));
      label.style.visibility = free && mark.visible && at.z < 1 ? "visible" : "hidden";
      if (!free || !mark.visible) continue;
      taken.push([free[0], free[1], free[0] + w, free[1] + h]);
      label.style.transform = `translate(${free[0].toFixed(1)}px, ${free[1].toFixed(1)}px)`;
    }
  }

  // the object under the pointer, for the tooltip
  pick(event) {
    const area = this.stage.getBoundingClientRect();
    const at = new Vector2((2 * (event.clientX - area.left)) / area.width - 1, 1 - (2 * (event.clientY - area.top)) / area.height);
    const ray = new Raycaster();
    ray.setFromCamera(at, this.camera);
    const share = (name) => {
      const found = this.shape === null ? undefined : this.about().shares[name];
      return found === undefined ? "" : ` – ${percent(found)} of the strain energy`;
    };
    const marks = this.marks.visible ? ray.intersectObjects(this.marks.children.filter((mark) => mark.visible), false) : [];
    if (marks.length) return marks[0].object.userData.text + share(marks[0].object.userData.name);
    const meshes = this.bodies.filter((body) => body.visible).map((body) => body.mesh);
    const hit = ray.intersectObjects(meshes, false).find((other) => this.isLeft(other.point));
    if (!hit) return "";
    const { name } = this.bodies.find((body) => body.mesh === hit.object).component;
    return name + share(name);
  }

  // a small picture of a shape at its turning point, drawn off screen
  thumbnail(pose, id) {
    const kept = [this.pose, this.shape, this.playing, this.phase];
    const target = this.thumbTarget ??= new WebGLRenderTarget(THUMB[0], THUMB[1], { samples: 4 });
    const camera = this.thumbCamera ??= new OrthographicCamera();
    if (pose !== this.pose) this.placePose(pose);
    this.showShape(id);
    this.marks.visible = this.arrows.visible = false;
    for (const body of this.bodies) {
      body.ghost.visible = false;
      if (body.web) body.web.visible = false;
      if (body.caps) body.caps.lid.visible = false;
    }
    this.fitThumbnail(camera);
    this.shared.field.value = FIELDS.displacement;
    this.shared.swing.value = SWING_SHARE * this.size;
    this.headlight.quaternion.copy(camera.quaternion);
    this.headlight.updateMatrixWorld(true);
    this.renderer.localClippingEnabled = this.planes.length === 0;
    this.renderer.setRenderTarget(target);
    this.renderer.clear();
    this.renderer.render(this.scene, camera);
    const pixels = new Uint8Array(4 * THUMB[0] * THUMB[1]);
    this.renderer.readRenderTargetPixels(target, 0, 0, THUMB[0], THUMB[1], pixels);
    this.renderer.setRenderTarget(null);
    this.arrows.visible = true;
    for (const body of this.bodies) if (body.web) body.web.visible = byId("show-web").checked;
    if (pose !== kept[0]) this.placePose(kept[0]);
    this.showShape(kept[1]);
    [this.playing, this.phase] = kept.slice(2);
    this.renderer.localClippingEnabled = true;
    return toCanvas(pixels);
  }

  fitThumbnail(camera) {
    const direction = new Vector3().fromArray(VIEWS.iso).normalize();
    const center = this.middle();
    const right = new Vector3(0, 0, 1).cross(direction).normalize();
    const up = direction.clone().cross(right);
    let half = 0;
    for (const arm of this.corners(center)) {
      half = Math.max(half, Math.abs(arm.dot(up)), (Math.abs(arm.dot(right)) * THUMB[1]) / THUMB[0]);
    }
    half = 1.02 * half + 0.5 * SWING_SHARE * this.size;
    const wide = (half * THUMB[0]) / THUMB[1];
    Object.assign(camera, { left: -wide, right: wide, top: half, bottom: -half, near: 0, far: 8 * this.size });
    camera.up.set(0, 0, 1);
    camera.position.copy(center).addScaledVector(direction, 4 * this.size);
    camera.lookAt(center);
    camera.updateProjectionMatrix();
    camera.updateMatrixWorld(true);
  }
}

// render targets hold linear, premultiplied colours upside down
function toCanvas(pixels) {
  const canvas = make("canvas", "thumb");
  [canvas.width, canvas.height] = THUMB;
  const image = new ImageData(THUMB[0], THUMB[1]);
  const row = 4 * THUMB[0];
  for (let y = 0; y < THUMB[1]; y++) {
    for (let x = 0; x < row; x += 4) {
      const from = (THUMB[1] - 1 - y) * row + x;
      const to = y * row + x;
      const opacity = pixels[from + 3] / 255;
      for (let k = 0; k < 3; k++) {
        const linear = opacity ? Math.min(1, pixels[from + k] / 255 / opacity) : 0;
        image.data[to + k] = 255 * (linear <= 0.0031308 ? 12.92 * linear : 1.055 * linear ** (1 / 2.4) - 0.055);
      }
      image.data[to + 3] = pixels[from + 3];
    }
  }
  canvas.getContext("2d").putImageData(image, 0, 0);
  return canvas;
}

function drawTriad(camera) {
  const triad = byId("triad");
  const turn = camera.quaternion.clone().invert();
  ["X", "Y", "Z"].map((name, i) => [name, new Vector3().setComponent(i, 1).applyQuaternion(turn), i])
    .sort((a, b) => a[1].z - b[1].z)
    .forEach(([name, v]) => {
      const group = triad.querySelector(`[data-axis="${name}"]`);
      triad.append(group);
      const [x, y] = [36 + 24 * v.x, 36 - 24 * v.y];
      const line = group.querySelector("line");
      line.setAttribute("x2", x.toFixed(1));
      line.setAttribute("y2", y.toFixed(1));
      const text = group.querySelector("text");
      text.setAttribute("x", (36 + 31.5 * v.x).toFixed(1));
      text.setAttribute("y", (39.5 - 31.5 * v.y).toFixed(1));
    });
}

const percent = (share) => `${share < 0.0995 ? (100 * share).toFixed(1) : Math.round(100 * share)} %`;

// three significant digits, thousands apart
function figure(value) {
  if (value === 0) return "0";
  if (Math.abs(value) < 1e-3 || Math.abs(value) >= 1e6) return value.toExponential(1).replace("e", "·10^").replace("+", "").replace("-", "−");
  const decimals = Math.max(0, 2 - Math.floor(Math.log10(Math.abs(value))));
  return Number(value.toFixed(decimals)).toLocaleString("en-US", { maximumFractionDigits: decimals }).replaceAll(",", "\u202f");
}

const metres = (value) => (value < 1 ? `${figure(1000 * value)} mm` : `${figure(value)} m`);

// what the colours mean, in numbers, and by how much the motion is enlarged
function showLegend(viewer) {
  const legend = byId("legend");
  legend.hidden = viewer.shape === null;
  if (legend.hidden) return;
  const about = viewer.about();
  const field = viewer.field();
  const drawn = viewer.amplitude;
  const force = about.kind === "force";
  const scale = force ? `drawn ${figure(drawn / about.largest)} times as large` : `1 is drawn as ${metres(drawn)}`;
  const shares = [0, 0.25, 0.5, 0.75, 1];
  let [title, values, note] = ["", [], scale];
  if (field === "displacement") {
    title = force ? "Displacement under 1 kN [µm]" : "Displacement, largest = 1";
    values = shares.map((share) => share * (force ? 1e6 * about.largest : 1));
  } else if (field === "energy") {
    // of a mode as a share of its energy per cubic decimetre; colours follow the square root
    title = force ? "Strain energy density under 1 kN [J/m³]" : "Strain energy density [% of the mode’s per dm³]";
    values = shares.map((share) => share * share * about.peak * (force ? 1 : 0.1));
    note = "at the surface; grey: not resolved in the part";
  } else title = "Components in their colours";
  byId("legend-title").textContent = title;
  byId("legend-bar").hidden = values.length === 0;
  byId("legend-numbers").replaceChildren(...values.map((value, i) => make("span", "", (field === "energy" && i === values.length - 1 ? "≥ " : "") + figure(value))));
  byId("legend-note").textContent = note;
}

function wireControls(viewer) {
  const play = byId("play");
  const show = () => { play.textContent = viewer.playing ? "❚❚" : "▶"; play.title = viewer.playing ? "Pause" : "Play"; play.setAttribute("aria-label", play.title); };
  play.addEventListener("click", () => { viewer.playing = !viewer.playing; if (!viewer.playing) viewer.phase = 0.25; viewer.dirty = true; show(); });
  viewer.playing = !window.matchMedia("(prefers-reduced-motion: reduce)").matches;
  show();
  byId("amplitude").addEventListener("input", () => { viewer.dirty = true; showLegend(viewer); });
  for (const id of ["colour", "show-joints", "show-rest"]) byId(id).addEventListener("change", () => { const phase = viewer.phase; viewer.showShape(viewer.shape); viewer.phase = phase; });
  byId("show-web").addEventListener("change", (event) => viewer.showWeb(event.target.checked));
  const cut = () => {
    const axis = byId("section").value;
    byId("section-place").hidden = byId("section-turn").hidden = !axis;
    viewer.cutAcross(axis, Number(byId("section-place").value), byId("section-turn").getAttribute("aria-pressed") === "true");
  };
  for (const id of ["section", "section-place"]) byId(id).addEventListener("input", cut);
  byId("section-turn").addEventListener("click", (event) => {
    event.target.setAttribute("aria-pressed", String(event.target.getAttribute("aria-pressed") !== "true"));
    cut();
  });
  byId("show-edges").addEventListener("change", (event) => { for (const body of viewer.bodies) body.edges.visible = event.target.checked; viewer.dirty = true; });
  for (const button of document.querySelectorAll("[data-view]")) button.addEventListener("click", () => viewer.look(button.dataset.view));
  byId("save-view").addEventListener("click", () => {
    viewer.draw();
    viewer.renderer.domElement.toBlob((blob) => save(blob, "machine.png"));
  });
  const tip = byId("tip");
  viewer.stage.addEventListener("pointermove", (event) => {
    const text = event.buttons ? "" : viewer.pick(event);
    tip.textContent = text;
    tip.hidden = !text;
    const area = viewer.stage.getBoundingClientRect();
    tip.style.transform = `translate(${event.clientX - area.left + 14}px, ${event.clientY - area.top + 12}px)`;
  });
  viewer.stage.addEventListener("pointerleave", () => { tip.hidden = true; });
}

function wireParts(viewer) {
  const list = byId("parts");
  list.replaceChildren();
  for (const body of viewer.bodies) {
    const row = make("label", "part");
    const box = make("input");
    box.type = "checkbox";
    box.checked = true;
    const dot = make("span", "dot");
    dot.style.background = body.component.color;
    const { source, triangles, whole } = body.component;
    const kind = { mesh: "meshed", solid: "not meshed", inertia: "drawn as a block of equal inertia" }[source] || "";
    row.title = `${kind}${kind ? ", " : ""}drawn with ${figure(triangles)}${whole > triangles ? ` of ${figure(whole)}` : ""} faces`;
    body.note = make("small", "", kind);
    body.kind = kind;
    row.append(box, dot, make("span", "", body.component.name), body.note);
    box.addEventListener("change", () => { body.visible = box.checked; body.group.visible = box.checked; viewer.dirty = true; });
    row.addEventListener("pointerenter", () => { body.mesh.material.emissive.set("#5a4a20"); viewer.dirty = true; });
    row.addEventListener("pointerleave", () => { body.mesh.material.emissive.set("#000000"); viewer.dirty = true; });
    list.append(row);
  }
}

// the list of shapes beside the picture; the rows of the tables below choose from it too
function wireShapes(viewer) {
  const list = byId("shapes");
  const poses = byId("pose-choice");
  const rows = () => document.querySelectorAll("tr[data-shape]");
  const choose = (pose, id) => {
    if (pose !== viewer.pose) { viewer.shape = id; viewer.placePose(pose); } else viewer.showShape(id);
    for (const item of list.children) item.setAttribute("aria-pressed", String(item.dataset.shape === (id ?? "")));
    const chosen = list.querySelector("[aria-pressed=true]");
    if (chosen) list.scrollTop = Math.min(Math.max(list.scrollTop, chosen.offsetTop + chosen.offsetHeight - list.clientHeight), chosen.offsetTop);
    for (const row of rows()) row.classList.toggle("chosen", Number(row.dataset.pose) === pose && row.dataset.shape === id);
    byId("motion").hidden = id === null;
    for (const body of viewer.bodies) {
      const share = id === null ? undefined : viewer.about().shares[body.component.name];
      body.note.textContent = share === undefined ? body.kind : `${percent(share)} of the strain energy`;
    }
    byId("caption").textContent = id === null ? "At rest" : viewer.captions.get(`${pose} ${id}`) || "";
  };
  viewer.captions = new Map();
  viewer.data.poses.forEach((pose, number) => {
    for (const about of pose.shapes) viewer.captions.set(`${number} ${about.id}`, `${about.lead} · ${about.text}`);
  });
  const fill = (number) => {
    list.replaceChildren();
    const add = (id, lead, text) => {
      const item = make("button", "shape");
      item.type = "button";
      item.dataset.shape = id ?? "";
      const words = make("span", "words");
      words.append(make("b", "", lead), make("span", "", text));
      item.append(make("span", "frame"), words);
      item.addEventListener("click", () => choose(number, id));
      list.append(item);
    };
    add(null, "At rest", "joints and points");
    list.scrollTop = 0;
    for (const about of viewer.data.poses[number].shapes) add(about.id, about.lead, about.text);
    if (viewer.thumbs) placeThumbs(viewer, number);
  };
  if (viewer.data.poses.length > 1) {
    viewer.data.poses.forEach((pose, number) => {
      const button = make("button", "", pose.name);
      button.type = "button";
      button.setAttribute("aria-pressed", String(number === 0));
      button.addEventListener("click", () => {
        const kept = viewer.shape;
        fill(number);
        choose(number, viewer.shapes[number].has(kept) ? kept : null);
        for (const other of poses.children) other.setAttribute("aria-pressed", String(other === button));
        fitList();
      });
      poses.append(button);
    });
  }
  for (const row of rows()) {
    row.addEventListener("click", () => {
      const number = Number(row.dataset.pose);
      if (!viewer.shapes[number]?.has(row.dataset.shape)) return;
      if (number !== viewer.pose) poses.children[number]?.click();
      choose(number, row.dataset.shape);
      byId("machine").scrollIntoView({ behavior: "smooth", block: "start" });
    });
  }
  fill(0);
  const offered = viewer.data.poses[0].shapes;
  // what deforms, rather than the motions of the whole machine on its mounts, which are the last of the list
  choose(0, (offered.find((about) => about.kind === "mode") ?? offered[0])?.id ?? null);
  return { fill, choose };
}

// whole rows only
function fitList() {
  const list = byId("shapes");
  const row = list.firstElementChild?.offsetHeight;
  if (!row) return;
  const parts = byId("parts");
  list.style.flex = list.style.height = parts.style.flex = parts.style.maxHeight = "";
  const rows = Math.max(2, Math.floor((list.clientHeight + 1) / row));
  list.style.flex = "none";
  Object.assign(parts.style, { flex: "1 1 auto", maxHeight: "none" });
  list.style.height = `${Math.min(rows, list.childElementCount) * row + list.offsetHeight - list.clientHeight}px`;
}

function placeThumbs(viewer, number) {
  for (const item of byId("shapes").children) {
    const thumb = viewer.thumbs.get(`${number} ${item.dataset.shape}`);
    if (thumb) item.querySelector(".frame").replaceChildren(thumb);
  }
}

function makeThumbs(viewer) {
  viewer.thumbs = new Map();
  const work = [];
  viewer.shapes.forEach((shapes, pose) => { for (const id of shapes.keys()) work.push([pose, id]); });
  const step = () => {
    const [pose, id] = work.shift() ?? [];
    if (id === undefined) return;
    const canvas = viewer.thumbnail(pose, id);
    viewer.thumbs.set(`${pose} ${id}`, canvas);
    const row = [...document.querySelectorAll("tr[data-shape]")].find((r) => Number(r.dataset.pose) === pose && r.dataset.shape === id);
    const cell = row?.querySelector(".picture");
    if (cell) {
      const copy = canvas.cloneNode();
      copy.getContext("2d").drawImage(canvas, 0, 0);
      cell.replaceChildren(copy);
    }
    if (pose === viewer.pose) placeThumbs(viewer, pose);
    setTimeout(step, 0);
  };
  step();
}

function save(blob, name) {
  const link = make("a");
  link.href = URL.createObjectURL(blob);
  link.download = name;
  link.click();
  setTimeout(() => URL.revokeObjectURL(link.href), 10000);
}

// tables and charts as PNG, drawn in the reader's own browser
function tableImage(table) {
  const rows = [...table.rows].map((row) => [...row.cells].filter((c) => !c.matches(".picture, .bars")).map((cell) => ({
    text: cell.innerText.replace(/\s+/g, " ").trim(), head: cell.tagName === "TH", right: cell.classList.contains("number"),
  })));
  const canvas = make("canvas");
  const pen = canvas.getContext("2d");
  const font = (head) => `${head ? "600 " : ""}26px system-ui, sans-serif`;
  const widths = [];
  for (const row of rows) row.forEach((cell, i) => { pen.font = font(cell.head); widths[i] = Math.max(widths[i] || 0, pen.measureText(cell.text).width + 44); });
  canvas.width = widths.reduce((a, b) => a + b, 24);
  canvas.height = 46 * rows.length + 24;
  pen.fillStyle = "#ffffff";
  pen.fillRect(0, 0, canvas.width, canvas.height);
  rows.forEach((row, j) => {
    let x = 12;
    row.forEach((cell, i) => {
      pen.font = font(cell.head);
      pen.fillStyle = cell.head ? "#52606f" : "#16202b";
      pen.textAlign = cell.right ? "right" : "left";
      pen.fillText(cell.text, cell.right ? x + widths[i] - 22 : x + 22, 46 * j + 42);
      x += widths[i];
    });
    pen.fillStyle = "#dde3ea";
    pen.fillRect(12, 46 * (j + 1) + 10, canvas.width - 24, 2);
  });
  return Promise.resolve(canvas);
}

function chartImage(svg) {
  const copy = svg.cloneNode(true);
  const [, , width, height] = svg.getAttribute("viewBox").split(" ").map(Number);
  copy.setAttribute("xmlns", "http://www.w3.org/2000/svg");
  copy.setAttribute("width", 3 * width);
  copy.setAttribute("height", 3 * height);
  copy.setAttribute("style", "color:#16202b;font-family:system-ui,sans-serif");
  const image = new Image();
  const canvas = Object.assign(make("canvas"), { width: 3 * width, height: 3 * height });
  return new Promise((resolve) => {
    image.onload = () => {
      const pen = canvas.getContext("2d");
      pen.fillStyle = "#ffffff";
      pen.fillRect(0, 0, canvas.width, canvas.height);
      pen.drawImage(image, 0, 0);
      resolve(canvas);
    };
    image.src = `data:image/svg+xml;charset=utf-8,${encodeURIComponent(new XMLSerializer().serializeToString(copy))}`;
  });
}

function wireDownloads() {
  for (const button of document.querySelectorAll("[data-png]")) {
    button.hidden = false;
    button.addEventListener("click", async () => {
      const figure = byId(button.dataset.png);
      const canvas = await (figure.tagName === "TABLE" ? tableImage(figure) : chartImage(figure));
      canvas.toBlob((blob) => save(blob, `${button.dataset.png}.png`));
    });
  }
}

async function start() {
  wireDownloads();
  const source = byId("machine-data");
  if (!source) return;
  const data = JSON.parse(source.textContent);
  const read = reader(await unpack(data.blob));
  const components = readComponents(data, read);
  const shapes = readShapes(data, components, read);
  const viewer = new Viewer(data, components, shapes);
  document.documentElement.classList.add("live");
  wireControls(viewer);
  wireParts(viewer);
  const { choose } = wireShapes(viewer);
  viewer.resize();
  viewer.look("iso");
  new ResizeObserver(() => { viewer.resize(); fitList(); }).observe(viewer.stage);
  new IntersectionObserver((entries) => { viewer.seen = entries.at(-1).isIntersecting; viewer.dirty = true; }).observe(viewer.stage);
  const wanted = new URLSearchParams(location.hash.slice(1)).get("shape");
  if (wanted && shapes[0].has(wanted)) choose(0, wanted);
  let last = performance.now();
  const loop = (now) => { viewer.frame(Math.min(0.1, (now - last) / 1000)); last = now; requestAnimationFrame(loop); };
  requestAnimationFrame(loop);
  setTimeout(() => makeThumbs(viewer), 60);
}

start().catch((error) => {
  // no WebGL, or a browser that is too old: the still picture stays
  document.documentElement.classList.remove("live");
  const note = byId("no-3d");
  if (note) { note.hidden = false; note.title = String(error); }
});
