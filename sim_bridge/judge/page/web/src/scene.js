// The flight in 3D. three.js: x east, y up, z south.
import {
  AmbientLight, BufferAttribute, BufferGeometry, CanvasTexture, Color, ConeGeometry, CylinderGeometry, DirectionalLight, DoubleSide,
  GridHelper, InstancedMesh, Line, LineBasicMaterial, LineLoop, LineSegments, Matrix4, Mesh, MeshBasicMaterial, MeshLambertMaterial,
  PerspectiveCamera, Plane, Quaternion, Raycaster, RingGeometry, SRGBColorSpace, Scene, Sprite, SpriteMaterial, Vector2, Vector3, WebGLRenderer,
} from "three";
import { OrbitControls } from "three/addons/controls/OrbitControls.js";
import { reach } from "./shadow.js";
import { colours, vehicleColour } from "./theme.js";
import { SCAN_ROWS, upTo } from "./replay.js";

const TRAIL_ROWS = 120;
const VEHICLE_M = 1.6; // larger than life, to be seen
const SEEN_FROM_M = 45; // further off they grow, and stay as large on the screen
const UP = new Vector3(0, 1, 0);
const GROUND = new Plane(UP, 0);

// "#rrggbbaa" and hsl of the style sheet -> colour, without alpha.
const plain = (text) => new Color(/^#[0-9a-f]{8}$/i.test(text) ? text.slice(0, 7) : text);

export class Scene3D {
  constructor(root, replay, layers, changed) {
    this.root = root;
    this.replay = replay;
    this.layers = layers;
    this.changed = changed;
    this.renderer = new WebGLRenderer({ antialias: true, preserveDrawingBuffer: true });
    const { domElement } = this.renderer;
    domElement.tabIndex = 0;
    domElement.setAttribute("role", "img");
    domElement.setAttribute("aria-label", "the flight in 3D: drag turns it, arrow keys move it");
    root.append(domElement);
    this.camera = new PerspectiveCamera(50, 1, 0.1, 5000);
    this.controls = new OrbitControls(this.camera, domElement);
    this.controls.maxPolarAngle = Math.PI / 2 - 0.02;
    domElement.style.touchAction = "pan-y"; // a finger that goes up or down scrolls the page
    this.controls.listenToKeyEvents(domElement);
    this.controls.addEventListener("change", changed);
    this.build();
    this.fit();
    new ResizeObserver(() => changed()).observe(root);
  }

  build() {
    const { replay } = this;
    const ink = colours();
    this.scene = new Scene();
    this.scene.background = plain(ink.ground);
    this.scene.add(new AmbientLight(0xffffff, 1.6));
    const sun = new DirectionalLight(0xffffff, 2);
    sun.position.set(60, 120, 40);
    this.scene.add(sun);
    this.grid(ink);
    this.forest(ink);
    this.mission(ink);
    const count = replay.vehicles.length;
    const cone = new ConeGeometry(VEHICLE_M * 0.45, VEHICLE_M, 8).rotateX(-Math.PI / 2);
    this.cones = new InstancedMesh(cone, new MeshLambertMaterial(), count);
    this.cones.frustumCulled = false;
    this.scene.add(this.cones);
    this.ghosts = replay.against && new InstancedMesh(cone, new MeshBasicMaterial({ wireframe: true }), replay.against.vehicles.length);
    if (this.ghosts) {
      this.ghosts.frustumCulled = false;
      this.scene.add(this.ghosts);
    }
    this.crown = new Mesh(new RingGeometry(1.4, 1.8, 40).rotateX(-Math.PI / 2), new MeshBasicMaterial({ color: plain(ink.leader), side: DoubleSide }));
    this.scene.add(this.crown);
    this.links = this.lines(new LineSegments(new BufferGeometry(), new LineBasicMaterial({ color: plain(ink.link), transparent: true, opacity: 0.5 })), 2 * replay.pairs.length);
    this.drops = this.lines(new LineSegments(new BufferGeometry(), new LineBasicMaterial({ color: plain(ink.faint), transparent: true, opacity: 0.5 })), 2 * count);
    this.radio = this.lines(new LineLoop(new BufferGeometry(), new LineBasicMaterial({ color: plain(ink.radioEdge), transparent: true, opacity: 0.25 })), 720);
    const sectors = replay.vehicles.reduce((sum, { scans }) => sum + (scans?.sectors ?? 0), 0);
    this.scans = this.lines(new LineSegments(new BufferGeometry(), new LineBasicMaterial({ color: plain(ink.accent), transparent: true, opacity: 0.6 })), 2 * sectors);
    const material = (k) => new LineBasicMaterial({ color: plain(vehicleColour(k)) });
    this.trails = replay.vehicles.map((_, k) => this.lines(new Line(new BufferGeometry(), material(k)), replay.room));
    this.names = count <= 30 ? replay.vehicles.map(({ id }) => this.label(String(id), ink)) : [];
  }

  // A line of so many points at most, that is filled anew for each frame.
  lines(line, points) {
    line.geometry.setAttribute("position", new BufferAttribute(new Float32Array(3 * Math.max(1, points)), 3));
    line.frustumCulled = false;
    this.scene.add(line);
    return line;
  }

  fill(line, points) {
    const { position } = line.geometry.attributes;
    points.forEach(([east, north, up], i) => position.setXYZ(i, east, up, -north));
    position.needsUpdate = true;
    line.geometry.setDrawRange(0, points.length);
  }

  extent() {
    const { vehicles, mission } = this.replay;
    const east = vehicles.flatMap((one) => [one.east_m[0] ?? 0, one.east_m.at(-1) ?? 0]).concat(mission.places.map(({ enu_m: at }) => at[0]));
    const north = vehicles.flatMap((one) => [one.north_m[0] ?? 0, one.north_m.at(-1) ?? 0]).concat(mission.places.map(({ enu_m: at }) => at[1]));
    const [west, eastmost, south, northmost] = [Math.min(...east), Math.max(...east), Math.min(...north), Math.max(...north)];
    return { east: (west + eastmost) / 2, north: (south + northmost) / 2, size: Math.max(40, eastmost - west, northmost - south) };
  }

  grid(ink) {
    const { east, north, size } = this.extent();
    const wide = Math.ceil((size * 1.8) / 20) * 20;
    const grid = new GridHelper(wide, wide / 10, plain(ink.edge), plain(ink.grid));
    grid.position.set(Math.round(east / 10) * 10, -0.02, -Math.round(north / 10) * 10);
    this.scene.add(grid);
  }

  forest(ink) {
    const { trees, bushes } = this.replay;
    const trunk = new MeshLambertMaterial({ color: plain(ink.trunk) });
    const thin = 0.1; // m: it is still seen
    this.cylinders(trees, trunk, (i) => [Math.max(thin, trees.radius_m[i]), trees.ground_up_m[i], trees.height_m[i]]);
    const leaves = new MeshLambertMaterial({ color: plain(ink.crown), transparent: true, opacity: 0.06, depthWrite: false });
    this.crowns = this.cylinders(trees, leaves, (i) => {
      const high = trees.height_m[i] - trees.crown_base_m[i];
      return high > 0.05 ? [trees.crown_radius_m[i], trees.ground_up_m[i] + trees.crown_base_m[i], high] : null;
    });
    const brush = new MeshLambertMaterial({ color: plain(ink.bush), transparent: true, opacity: 0.5 });
    this.cylinders(bushes, brush, (i) => [bushes.radius_m[i], bushes.ground_up_m[i], bushes.height_m[i]]);
  }

  // One draw call for all. `shape`: radius, foot and height of the tree at an index; null: none.
  cylinders(table, material, shape) {
    const shapes = Array.from(table.east_m, (_, i) => [i, shape(i)]).filter(([, found]) => found);
    const mesh = new InstancedMesh(new CylinderGeometry(1, 1, 1, 8), material, shapes.length);
    const matrix = new Matrix4();
    shapes.forEach(([i, [radius, foot, high]], at) => {
      matrix.makeScale(radius, high, radius).setPosition(table.east_m[i], foot + high / 2, -table.north_m[i]);
      mesh.setMatrixAt(at, matrix);
    });
    mesh.frustumCulled = false;
    if (shapes.length) this.scene.add(mesh);
    return mesh;
  }

  mission(ink) {
    const { mission } = this.replay;
    const ring = (points, colour) => {
      const line = this.lines(new LineLoop(new BufferGeometry(), new LineBasicMaterial({ color: plain(colour) })), points.length);
      this.fill(line, points);
    };
    if (mission.fence_enu_m.length) {
      for (const up of mission.altitude_m) ring(mission.fence_enu_m.map(([e, n]) => [e, n, up]), ink.alarm);
    }
    const turns = Array.from({ length: 96 }, (_, i) => (2 * Math.PI * i) / 96);
    const { radius_m: r, shape } = mission.coverage;
    for (const [e, n, u] of mission.coverage.centres_enu_m) {
      ring(turns.map((a) => [e + r * Math.cos(a), n + r * Math.sin(a), u]), ink.faint);
      if (shape === "sphere") {
        ring(turns.map((a) => [e + r * Math.cos(a), n, u + r * Math.sin(a)]), ink.faint);
        ring(turns.map((a) => [e, n + r * Math.cos(a), u + r * Math.sin(a)]), ink.faint);
      }
    }
    for (const { name, enu_m: [e, n, u] } of mission.places) this.label(name, ink).position.set(e, u + 2, -n);
  }

  label(text, ink) {
    const canvas = document.createElement("canvas");
    [canvas.width, canvas.height] = [192, 64];
    const pen = canvas.getContext("2d");
    pen.font = "600 40px system-ui, sans-serif";
    pen.textAlign = "center";
    pen.lineWidth = 8;
    pen.strokeStyle = ink.halo;
    pen.fillStyle = ink.ink;
    pen.strokeText(text, 96, 46);
    pen.fillText(text, 96, 46);
    const map = new CanvasTexture(canvas);
    map.colorSpace = SRGBColorSpace; // else black letters are grey
    const sprite = new Sprite(new SpriteMaterial({ map, depthTest: false, sizeAttenuation: false }));
    sprite.scale.set(0.11, 0.037, 1);
    sprite.renderOrder = 1; // over the crowns
    this.scene.add(sprite);
    return sprite;
  }

  fit() {
    const { east, north, size } = this.extent();
    this.controls.target.set(east, 4, -north);
    const back = size * this.narrow();
    this.camera.position.set(east - back * 0.25, back * 0.42, -north + back * 0.72);
    this.controls.update();
    this.changed();
  }

  // East and north of the ground at a pixel; null: the sky.
  enu(px, py) {
    const eye = new Raycaster();
    eye.setFromCamera(new Vector2((2 * px) / this.root.clientWidth - 1, 1 - (2 * py) / this.root.clientHeight), this.camera);
    const hit = eye.ray.intersectPlane(GROUND, new Vector3());
    return hit && [hit.x, -hit.z];
  }

  // How much farther back a camera stands in an upright window, to see as much from side to side.
  narrow() {
    return Math.max(1, this.root.clientHeight / Math.max(1, this.root.clientWidth));
  }

  // The first look is at the swarm, from behind and above.
  near(places) {
    this.looked = true;
    const mean = [0, 1, 2].map((axis) => places.reduce((sum, place) => sum + place[axis], 0) / Math.max(1, places.length));
    const spread = Math.max(12, ...places.map((place) => Math.hypot(place[0] - mean[0], place[1] - mean[1]))) * this.narrow();
    this.controls.target.set(mean[0], mean[2], -mean[1]);
    this.camera.position.set(mean[0] - spread * 1.5, mean[2] + spread * 1.1, -mean[1] + spread * 1.2);
    this.controls.update();
  }

  zoom(factor) {
    const { target } = this.controls;
    this.camera.position.sub(target).divideScalar(factor).add(target);
    this.controls.update();
    this.changed();
  }

  show(time, selected) {
    const { replay, layers } = this;
    const [width, height] = [this.root.clientWidth, this.root.clientHeight];
    if (!width || !height) return;
    this.renderer.setPixelRatio(Math.min(2, devicePixelRatio));
    this.renderer.setSize(width, height);
    this.camera.aspect = width / height;
    this.camera.updateProjectionMatrix();
    if (replay.time.length) this.move(replay.at(time), time, selected);
    this.crowns.visible = layers.crowns;
    this.renderer.render(this.scene, this.camera);
  }

  move(at, time, selected) {
    const { replay, layers } = this;
    const places = replay.vehicles.map((_, k) => replay.place(k, at));
    if (!this.looked) this.near(places);
    if (layers.follow) this.follow(replay.followed(selected, at));
    const [matrix, turn, size, colour] = [new Matrix4(), new Quaternion(), new Vector3(), new Color()];
    replay.vehicles.forEach((one, k) => {
      const [east, north, up] = places[k];
      const yaw = one.yaw_deg ? one.yaw_deg[at.row] || 0 : 0;
      turn.setFromAxisAngle(UP, (-yaw * Math.PI) / 180);
      const where = new Vector3(east, up, -north);
      size.setScalar(Math.max(1, where.distanceTo(this.camera.position) / SEEN_FROM_M));
      this.cones.setMatrixAt(k, matrix.compose(where, turn, size));
      const dim = !one.alive[at.row];
      this.cones.setColorAt(k, dim ? colour.set(0x888888) : colour.copy(plain(vehicleColour(k))));
      this.names[k]?.position.set(east, up + VEHICLE_M * size.x, -north);
    });
    this.cones.instanceMatrix.needsUpdate = true;
    this.cones.instanceColor.needsUpdate = true;
    const leader = replay.swarm.leader[at.row] - 1;
    this.crown.visible = leader >= 0;
    if (leader >= 0) {
      this.crown.position.set(places[leader][0], places[leader][2], -places[leader][1]);
      this.crown.scale.setScalar(Math.max(1, this.crown.position.distanceTo(this.camera.position) / SEEN_FROM_M));
    }
    this.links.visible = layers.links;
    this.fill(this.links, replay.linksAt(at.row).flatMap(({ a, b }) => [places[a], places[b]]));
    this.fill(this.drops, places.flatMap(([east, north, up]) => [[east, north, up], [east, north, 0]]));
    this.reached(selected ?? leader, at, places);
    this.trail(at, time, places);
    if (this.ghosts) this.haunt(time);
    this.scanned(at, places);
  }

  // The vehicles of the other flight.
  haunt(time) {
    const { against } = this.replay;
    this.ghosts.visible = this.layers.against;
    const at = against.at(time);
    const [matrix, turn, size, colour] = [new Matrix4(), new Quaternion(), new Vector3(), new Color()];
    against.vehicles.forEach((one, k) => {
      const [east, north, up] = against.place(k, at);
      const where = new Vector3(east, up, -north);
      turn.setFromAxisAngle(UP, (-(one.yaw_deg?.[at.row] || 0) * Math.PI) / 180);
      size.setScalar(Math.max(1, where.distanceTo(this.camera.position) / SEEN_FROM_M));
      this.ghosts.setMatrixAt(k, matrix.compose(where, turn, size));
      this.ghosts.setColorAt(k, colour.copy(plain(vehicleColour(k))));
    });
    this.ghosts.instanceMatrix.needsUpdate = true;
    this.ghosts.instanceColor.needsUpdate = true;
  }

  follow(seen) {
    if (!seen.length) return;
    const mean = [0, 1, 2].map((axis) => seen.reduce((sum, place) => sum + place[axis], 0) / seen.length);
    const shift = new Vector3(mean[0], mean[2], -mean[1]).sub(this.controls.target);
    this.controls.target.add(shift);
    this.camera.position.add(shift);
  }

  reached(k, at, places) {
    this.radio.visible = this.layers.ranges && k >= 0 && this.replay.vehicles[k].alive[at.row] === 1;
    if (!this.radio.visible) return;
    const [east, north, up] = places[k];
    const outline = reach(this.replay.trees, east, north, this.replay.vehicles[k].range_m[at.row], this.replay.attenuationFactor);
    this.fill(this.radio, outline.map(([e, n]) => [e, n, up]));
  }

  scanned(at, places) {
    this.scans.visible = this.layers.scans;
    if (!this.layers.scans) return;
    this.fill(this.scans, this.replay.vehicles.flatMap((_, k) => {
      const scan = this.replay.scanAt(k, at.row);
      return scan && scan.age <= SCAN_ROWS ? scan.points.flatMap(([e, n]) => [places[k], [e, n, places[k][2]]]) : [];
    }));
  }

  trail(at, time, places) {
    const { replay, layers } = this;
    const from = layers.tracks ? 0 : Math.max(0, upTo(replay.time, time) - 1 - TRAIL_ROWS);
    replay.vehicles.forEach((one, k) => {
      this.trails[k].visible = layers.trails || layers.tracks;
      if (!this.trails[k].visible) return;
      const points = [];
      for (let row = from; row < at.row; row++) points.push([one.east_m[row], one.north_m[row], one.up_m[row]]);
      this.fill(this.trails[k], [...points, places[k]].slice(-replay.room));
    });
  }

  // Colours are in every material: it is made anew.
  themed() {
    this.scene.traverse((thing) => {
      thing.geometry?.dispose();
      thing.material?.map?.dispose();
      thing.material?.dispose();
    });
    this.build();
  }
}
