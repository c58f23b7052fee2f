// The 3D view of the report: the machine at rest, under a force at a point, and swinging in its natural modes.
// Built into viewer.bundle.js by `npm ci && npm run build` in this folder; everything it shows comes from the page itself.
import {
  AmbientLight, BufferAttribute, BufferGeometry, Color, DirectionalLight, Group, HemisphereLight, LineBasicMaterial, LineSegments,
  Matrix4, Mesh, MeshBasicMaterial, MeshStandardMaterial, OctahedronGeometry, OrthographicCamera, PerspectiveCamera, Raycaster,
  Scene, SphereGeometry, Vector2, Vector3, WebGLRenderer, WebGLRenderTarget,
} from "three";
import { OrbitControls } from "three/addons/controls/OrbitControls.js";

const RAMP = ["#31459b", "#3e8fc4", "#7fcdbb", "#fee08b", "#f46d43", "#c51b3d"];
const VIEWS = { iso: [1.25, -1.0, 0.75], front: [1, 0, 0], side: [0, -1, 0], top: [0.0001, 0, 1] };
const KINDS = { rigid: "#64748b", spring: "#d97706", free: "#7c3aed" };
const FREE_KINDS = new Set(["revolute", "universal", "spherical", "prismatic"]);
const SWING_SHARE = 0.06;
const PERIOD = 1.6;
const THUMB = [216, 162];

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

// reads typed arrays one after the other; slices, so that alignment is no concern
function reader(buffer) {
  let place = 0;
  return (Type, count) => {
    const size = count * Type.BYTES_PER_ELEMENT;
    const part = new Type(buffer.slice(place, place + size));
    place += size;
    return part;
  };
}

function readComponents(data, read) {
  return data.components.map((about) => {
    const raw = read(Uint16Array, 3 * about.points);
    const points = new Float32Array(raw.length);
    for (let i = 0; i < raw.length; i++) points[i] = about.low[i % 3] + raw[i] * about.step[i % 3];
    const Index = about.wide ? Uint32Array : Uint16Array;
    return { ...about, position: points, faces: read(Index, 3 * about.triangles), lines: read(Index, 2 * about.edges) };
  });
}

// pose by pose a map from the id of a shape to a displacement per body: typed numbers, or six for one that moves rigidly
function readShapes(data, components, read) {
  const Type = data.bytes === 2 ? Int16Array : Int8Array;
  return data.poses.map((pose) =>
    new Map(pose.shapes.map(({ id, rigid }) => [id, components.map((c, i) => rigid[i] ?? read(Type, 3 * c.points))])));
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

// adds the displacement, given in machine axes, behind the placement of the body
function shifted(material, shared, tinted) {
  material.onBeforeCompile = (shader) => {
    Object.assign(shader.uniforms, shared);
    shader.vertexShader = shader.vertexShader
      .replace("#include <common>", "#include <common>\nattribute vec3 shift;\nuniform float swing;\nvarying float vShare;")
      .replace("#include <project_vertex>", `
        vShare = length(shift);
        vec4 placed = modelMatrix * vec4(transformed, 1.0);
        placed.xyz += swing * shift;
        vec4 mvPosition = viewMatrix * placed;
        gl_Position = projectionMatrix * mvPosition;`);
    if (!tinted) return;
    shader.fragmentShader = shader.fragmentShader
      .replace("#include <common>", `#include <common>\nuniform float tint;\nvarying float vShare;\n${ramp}`)
      .replace("#include <color_fragment>", "#include <color_fragment>\ndiffuseColor.rgb = mix(diffuseColor.rgb, ramp(vShare), tint);");
  };
  material.customProgramCacheKey = () => (tinted ? "shifted tinted" : "shifted");
  return material;
}

class Viewer {
  constructor(data, components, shapes) {
    Object.assign(this, { data, components, shapes, pose: 0, shape: null, playing: false, phase: 0.25, dirty: true });
    this.size = data.size;
    this.shared = { swing: { value: 0 }, tint: { value: 0 } };
    this.scene = new Scene();
    this.stage = byId("stage");
    this.renderer = new WebGLRenderer({ antialias: true, alpha: true });
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
      const face = new BufferGeometry().setAttribute("position", position).setAttribute("shift", rest);
      face.setIndex(new BufferAttribute(component.faces, 1));
      const line = new BufferGeometry().setAttribute("position", position).setAttribute("shift", rest);
      line.setIndex(new BufferAttribute(component.lines, 1));
      const surface = { color: component.color, flatShading: true, roughness: 0.62, metalness: 0.05 };
      const offset = { polygonOffset: true, polygonOffsetFactor: 1.2, polygonOffsetUnits: 1.2 };
      const mesh = new Mesh(face, shifted(new MeshStandardMaterial({ ...surface, ...offset }), this.shared, true));
      const edges = new LineSegments(line, shifted(new LineBasicMaterial({ color: "#131a24", transparent: true, opacity: 0.75 }), this.shared));
      const ghost = new LineSegments(line, new LineBasicMaterial({ color: "#7b8694", transparent: true, opacity: 0.4, depthWrite: false }));
      ghost.renderOrder = -1;
      ghost.visible = false;
      const group = new Group();
      group.add(mesh, edges, ghost);
      group.matrixAutoUpdate = false;
      for (const part of [mesh, edges, ghost]) part.frustumCulled = false;
      this.scene.add(group);
      return { component, group, mesh, edges, ghost, face, line, rest, visible: true };
    });
  }

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
    this.labels.replaceChildren();
    this.tags = [];
    for (const joint of pose.joints) {
      const kind = joint.kind === "rigid" ? "rigid" : FREE_KINDS.has(joint.kind) ? "free" : "spring";
      const glyph = new Mesh(new OctahedronGeometry(0.0085 * this.size), new MeshBasicMaterial({ color: KINDS[kind], depthTest: false, transparent: true, opacity: 0.9 }));
      glyph.position.fromArray(joint.at);
      glyph.renderOrder = 5;
      glyph.userData.text = `${joint.name}: ${joint.kind.replaceAll("_", " ")}, ${joint.first} – ${joint.second}`;
      this.marks.add(glyph);
    }
    for (const point of pose.points) {
      const ball = new Mesh(new SphereGeometry(0.011 * this.size, 20, 14), new MeshBasicMaterial({ color: "#d11a3a", depthTest: false, transparent: true }));
      ball.position.fromArray(point.at);
      ball.renderOrder = 6;
      ball.userData.text = `${point.name}: ${point.tool} relative to ${point.work}`;
      this.marks.add(ball);
      const label = make("span", "tag", point.name);
      this.labels.append(label);
      this.tags.push([ball, label]);
    }
    this.marks.visible = byId("show-joints").checked && this.shape === null;
  }

  partsOf(pose, id) {
    const parts = this.shapes[pose].get(id);
    parts.forEach((part, i) => {
      if (Array.isArray(part)) parts[i] = moveRigidly(part, this.data.poses[pose].frames[i], this.components[i].position);
    });
    return parts;
  }

  showShape(id) {
    this.shape = id;
    const parts = id === null ? null : this.partsOf(this.pose, id);
    this.bodies.forEach((body, i) => {
      const shift = parts ? new BufferAttribute(parts[i], 3, true) : body.rest;
      body.face.setAttribute("shift", shift);
      body.line.setAttribute("shift", shift);
      body.ghost.visible = parts !== null && byId("show-rest").checked;
    });
    this.marks.visible = parts === null && byId("show-joints").checked;
    this.labels.hidden = !this.marks.visible;
    this.shared.tint.value = parts && byId("by-displacement").checked ? 1 : 0;
    this.phase = 0.25;
    this.dirty = true;
  }

  look(name) {
    const box = this.data.box;
    const center = new Vector3().fromArray(box.map(([low, high]) => 0.5 * (low + high)));
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
    this.camera.position.copy(center).addScaledVector(direction, 1.06 * distance);
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
    this.camera.updateProjectionMatrix();
    this.renderer.setSize(width, height);
    this.dirty = true;
  }

  get amplitude() { return SWING_SHARE * this.size * Number(byId("amplitude").value); }

  frame(seconds) {
    if (this.playing && this.shape !== null) { this.phase = (this.phase + seconds / PERIOD) % 1; this.dirty = true; }
    this.controls.update();
    if (!this.dirty) return;
    this.dirty = false;
    this.draw();
  }

  draw() {
    this.shared.swing.value = this.shape === null ? 0 : this.amplitude * Math.sin(2 * Math.PI * this.phase);
    this.headlight.quaternion.copy(this.camera.quaternion);
    this.headlight.updateMatrixWorld(true);
    this.renderer.render(this.scene, this.camera);
    const { clientWidth: width, clientHeight: height } = this.stage;
    for (const [mark, label] of this.tags) {
      const place = mark.position.clone().project(this.camera);
      label.style.transform = `translate(${(0.5 * (place.x + 1) * width + 9).toFixed(1)}px, ${(0.5 * (1 - place.y) * height - 9).toFixed(1)}px)`;
    }
    drawTriad(this.camera);
  }

  // the object under the pointer, for the tooltip
  pick(event) {
    const area = this.stage.getBoundingClientRect();
    const at = new Vector2((2 * (event.clientX - area.left)) / area.width - 1, 1 - (2 * (event.clientY - area.top)) / area.height);
    const ray = new Raycaster();
    ray.setFromCamera(at, this.camera);
    const marks = this.marks.visible ? ray.intersectObjects(this.marks.children, false) : [];
    if (marks.length) return marks[0].object.userData.text;
    const meshes = this.bodies.filter((body) => body.visible).map((body) => body.mesh);
    const hit = ray.intersectObjects(meshes, false)[0];
    return hit ? this.bodies.find((body) => body.mesh === hit.object).component.name : "";
  }

  // a small picture of a shape at its turning point, drawn off screen
  thumbnail(pose, id) {
    const kept = [this.pose, this.shape, this.playing, this.phase, this.shared.tint.value];
    const target = this.thumbTarget ??= new WebGLRenderTarget(THUMB[0], THUMB[1], { samples: 4 });
    const camera = this.thumbCamera ??= new OrthographicCamera();
    if (pose !== this.pose) this.placePose(pose);
    this.showShape(id);
    this.marks.visible = false;
    for (const body of this.bodies) body.ghost.visible = false;
    this.fitThumbnail(camera);
    this.shared.tint.value = 1;
    this.shared.swing.value = SWING_SHARE * this.size;
    this.headlight.quaternion.copy(camera.quaternion);
    this.headlight.updateMatrixWorld(true);
    this.renderer.setRenderTarget(target);
    this.renderer.clear();
    this.renderer.render(this.scene, camera);
    const pixels = new Uint8Array(4 * THUMB[0] * THUMB[1]);
    this.renderer.readRenderTargetPixels(target, 0, 0, THUMB[0], THUMB[1], pixels);
    this.renderer.setRenderTarget(null);
    if (pose !== kept[0]) this.placePose(kept[0]);
    this.showShape(kept[1]);
    [this.playing, this.phase, this.shared.tint.value] = kept.slice(2);
    return toCanvas(pixels);
  }

  fitThumbnail(camera) {
    const direction = new Vector3().fromArray(VIEWS.iso).normalize();
    const center = new Vector3().fromArray(this.data.box.map(([low, high]) => 0.5 * (low + high)));
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

function wireControls(viewer) {
  const play = byId("play");
  const show = () => { play.textContent = viewer.playing ? "❚❚" : "▶"; play.title = viewer.playing ? "Pause" : "Play"; play.setAttribute("aria-label", play.title); };
  play.addEventListener("click", () => { viewer.playing = !viewer.playing; if (!viewer.playing) viewer.phase = 0.25; viewer.dirty = true; show(); });
  viewer.playing = !window.matchMedia("(prefers-reduced-motion: reduce)").matches;
  show();
  byId("amplitude").addEventListener("input", () => { viewer.dirty = true; });
  for (const id of ["by-displacement", "show-joints", "show-rest"]) byId(id).addEventListener("change", () => { const phase = viewer.phase; viewer.showShape(viewer.shape); viewer.phase = phase; });
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
    const about = make("small", "", { mesh: "meshed", solid: "not meshed", inertia: "drawn as a block of equal inertia" }[body.component.source] || "");
    row.append(box, dot, make("span", "", body.component.name), about);
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
    byId("legend").hidden = id === null;
    byId("motion").hidden = id === null;
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
  choose(0, null);
  return { fill, choose };
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
  new ResizeObserver(() => viewer.resize()).observe(viewer.stage);
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
