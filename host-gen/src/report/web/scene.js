"use strict";
// The machine in 3D, and its modes moving. SI units; z is up.

const BODY_COLOURS = [0x5b8db8, 0xd9a441, 0x7fb08a, 0xb784a7, 0x9aa5ad];
const LEG = 0xd55e00, BEAM = 0x6c757d, PIEZO = 0xf2b134, ACCELERATION = 0x0072b2, FORCE = 0xcc79a7, FLOOR = 0x8a9399, SPRING = 0x009e73, MASS = 0x785ef0;

/// Six numbers, translation of `reference` and rotation, at a point: first order.
function moved(motion, reference, point) {
  const [x, y, z] = [0, 1, 2].map((i) => point[i] - reference[i]);
  const [, , , a, b, c] = motion;
  return [motion[0] + b * z - c * y, motion[1] + c * x - a * z, motion[2] + a * y - b * x];
}

/// The largest of a list that may be too long for the arguments of Math.max.
function largest(list) {
  return list.reduce((a, b) => Math.max(a, b), -Infinity);
}

/// A coil of `wire` thickness and `radius` around the y axis from −1/2 to 1/2, to be drawn `length`
/// times as long.
function coil(length, radius, wire) {
  const turns = 6, steps = 20 * turns, sides = 6;
  const places = [], faces = [];
  for (let i = 0; i <= steps; i += 1) {
    const turn = (2 * Math.PI * turns * i) / steps;
    for (let k = 0; k < sides; k += 1) {
      const out = radius + wire * Math.cos((2 * Math.PI * k) / sides);
      const up = (wire / length) * Math.sin((2 * Math.PI * k) / sides);
      places.push(out * Math.cos(turn), i / steps - 0.5 + up, out * Math.sin(turn));
      if (i === steps) continue;
      const [a, b] = [i * sides + k, i * sides + ((k + 1) % sides)];
      faces.push(a, a + sides, b, b, a + sides, b + sides);
    }
  }
  const geometry = new THREE.BufferGeometry();
  geometry.setAttribute("position", new THREE.Float32BufferAttribute(places, 3));
  geometry.setIndex(faces);
  geometry.computeVertexNormals();
  return geometry;
}

/// Draws `machine` (a report) into `host`, an element of fixed size.
class Stage {
  constructor(host, machine) {
    this.host = host;
    this.scene = machine.scene;
    this.modes = machine.modes.modes;
    const points = this.scene.nodes.map((n) => n.at).concat(this.scene.bodies.map((b) => b.cog));
    const middle = [0, 1, 2].map((i) => {
      const all = points.map((p) => p[i]);
      return (-largest(all.map((x) => -x)) + largest(all)) / 2;
    });
    // Of a machine whose nodes are all at one place, some size.
    this.size = 2 * largest(points.map((p) => Math.hypot(...p.map((x, i) => x - middle[i])))) || 1;
    // What is behind it is the page's, dark or light.
    this.renderer = new THREE.WebGLRenderer({ antialias: true, alpha: true, preserveDrawingBuffer: true });
    this.renderer.setPixelRatio(Math.min(window.devicePixelRatio, 2));
    host.append(this.renderer.domElement);
    this.world = new THREE.Scene();
    this.world.add(new THREE.AmbientLight(0xffffff, 1.6));
    for (const [x, y, z, strength] of [[1, -1, 2, 1.9], [-2, 1, 1, 0.7]]) {
      const light = new THREE.DirectionalLight(0xffffff, strength);
      light.position.set(x, y, z);
      this.world.add(light);
    }
    this.camera = new THREE.PerspectiveCamera(32, 4 / 3, 0.01 * this.size, 20 * this.size);
    this.camera.up.set(0, 0, 1);
    const centre = new THREE.Vector3(...middle);
    this.camera.position.copy(centre).add(new THREE.Vector3(1.05, -1.35, 0.8).multiplyScalar(0.95 * this.size));
    this.orbit = new THREE.OrbitControls(this.camera, this.renderer.domElement);
    this.orbit.target.copy(centre);
    this.orbit.addEventListener("change", () => this.draw());
    this.labels = [];
    this.picked = [];
    this.build();
    this.mode = null;
    this.amplitude = 0.08;
    this.playing = true;
    this.phase = 0;
    this.largest = this.modes.map((mode) => {
      const lengths = this.scene.nodes.map((n) => Math.hypot(...this.shapeAt(mode, n)));
      return largest(lengths) || 1;
    });
    this.tip = document.createElement("div");
    this.tip.className = "tip";
    host.append(this.tip);
    this.renderer.domElement.addEventListener("pointermove", (event) => this.point(event));
    this.renderer.domElement.addEventListener("pointerleave", () => (this.tip.style.display = "none"));
    this.resize();
    this.observer = new ResizeObserver(() => this.resize());
    this.observer.observe(host);
    this.pose(0);
    this.orbit.update();
  }

  shapeAt(mode, node) {
    if (node.free) return mode.nodes.find((n) => n.node === node.name).motion.slice(0, 3);
    if (node.body === null) return [0, 0, 0];
    return moved(mode.shape[node.body].motion, this.scene.bodies[node.body].cog, node.at);
  }

  material(colour, opacity = 1) {
    return new THREE.MeshStandardMaterial({
      color: colour, roughness: 0.55, metalness: 0.05, transparent: opacity < 1, opacity, depthWrite: opacity === 1,
    });
  }

  /// What the pointer says of `object`.
  says(object, text) {
    object.userData.text = text;
    this.picked.push(object);
  }

  label(text, position) {
    const element = document.createElement("div");
    element.className = "label";
    element.textContent = text;
    this.host.append(element);
    this.labels.push({ element, position, size: [element.offsetWidth, element.offsetHeight] });
  }

  build() {
    const { nodes, beams, bodies, springs, point_masses, accelerometers, force_sensors, floor } = this.scene;
    const thin = 0.011 * this.size;
    const carried = bodies.map(() => []);
    for (const node of nodes) if (node.body !== null) carried[node.body].push(node.at);
    // Bodies: the hull around their nodes, as thick as a plate; moved as a whole.
    this.bodies = bodies.map((body, index) => {
      const group = new THREE.Group();
      group.matrixAutoUpdate = false;
      const own = carried[index];
      const corners = (own.length ? own : [body.cog]).flatMap((p) => {
        const at = p.map((x, i) => x - body.cog[i]);
        const directions = [[1, 1], [1, -1], [-1, 1], [-1, -1]];
        return directions.flatMap(([a, b]) => [-1, 1].map((c) =>
          new THREE.Vector3(at[0] + 1.6 * a * thin, at[1] + 1.6 * b * thin, at[2] + 1.3 * c * thin)));
      });
      const hull = new THREE.ConvexGeometry(corners);
      const colour = BODY_COLOURS[index % BODY_COLOURS.length];
      const mesh = new THREE.Mesh(hull, this.material(colour, 0.62));
      group.add(mesh);
      group.add(new THREE.LineSegments(new THREE.EdgesGeometry(hull, 25), new THREE.LineBasicMaterial({ color: 0x667683 })));
      const cog = new THREE.Mesh(new THREE.SphereGeometry(1.1 * thin, 24, 16), this.material(0x222a30));
      cog.material.depthTest = false;
      cog.renderOrder = 2;
      group.add(cog);
      this.says(mesh, `${body.name}\n${body.mass} kg`);
      this.says(cog, `centre of gravity of ${body.name}`);
      this.label(body.name, () => group.position.clone().setFromMatrixPosition(group.matrix));
      this.world.add(group);
      return group;
    });
    // Beams: a rod from end to end, of a leg with its piezo in the middle.
    this.beams = beams.map((beam, index) => {
      const leg = beam.channel !== null;
      const group = new THREE.Group();
      const radius = leg ? 0.6 * thin : 0.85 * thin;
      const rod = new THREE.Mesh(new THREE.CylinderGeometry(radius, radius, 1, 20), this.material(leg ? LEG : BEAM));
      group.add(rod);
      const facts = `EA/L ${short(beam.axial)} N/m, EI/L ${beam.bending.map((x) => short(x)).join(", ")} N m, GJ/L ${short(beam.torsion)} N m`;
      this.says(rod, `${beam.name}${leg ? `, channel ${beam.channel}` : ""}\n${facts}`);
      if (leg) {
        const piezo = new THREE.Mesh(new THREE.CylinderGeometry(1.25 * thin, 1.25 * thin, 0.34, 24), this.material(PIEZO));
        group.add(piezo);
        this.says(piezo, `actuator of ${beam.name}, channel ${beam.channel}`);
        this.label(beam.name, () => group.position.clone());
      }
      if (force_sensors.includes(index)) {
        const ring = new THREE.Mesh(new THREE.CylinderGeometry(1.35 * thin, 1.35 * thin, 0.07, 24), this.material(FORCE));
        ring.position.y = 0.24;
        group.add(ring);
        this.says(ring, `force sensor of ${beam.name}`);
      }
      this.world.add(group);
      return group;
    });
    // Springs: coils from node to node, or a ball where both are at one place.
    this.springs = springs.map(({ name, ends, stiffness }) => {
      const [p, q] = ends.map((end) => new THREE.Vector3(...nodes[end].at));
      const length = p.distanceTo(q);
      const joint = length < 2 * thin;
      const shape = joint ? new THREE.SphereGeometry(1.5 * thin, 20, 12) : coil(length, 1.1 * thin, 0.22 * thin);
      const spring = new THREE.Mesh(shape, this.material(SPRING));
      const numbers = (from) => stiffness.slice(from, from + 3).map((x) => short(x)).join(", ");
      this.says(spring, `spring ${name}\nx, y, z: ${numbers(0)} N/m\nabout x, y, z: ${numbers(3)} N m`);
      this.world.add(spring);
      return { spring, ends, joint };
    });
    this.masses = point_masses.map(({ name, node, mass }) => {
      const cube = new THREE.Mesh(new THREE.BoxGeometry(2.6 * thin, 2.6 * thin, 2.6 * thin), this.material(MASS));
      this.says(cube, `point mass ${name}\n${mass} kg`);
      this.world.add(cube);
      return { cube, node };
    });
    const arrow = (item, colour, length, what) => {
      const group = new THREE.Group();
      const shaft = new THREE.Mesh(new THREE.CylinderGeometry(0.28 * thin, 0.28 * thin, length, 12), this.material(colour));
      shaft.position.y = length / 2;
      const head = new THREE.Mesh(new THREE.ConeGeometry(0.85 * thin, 2.4 * thin, 20), this.material(colour));
      head.position.y = length;
      group.add(shaft, head);
      group.quaternion.setFromUnitVectors(new THREE.Vector3(0, 1, 0), new THREE.Vector3(...item.direction));
      for (const part of [shaft, head]) this.says(part, `${what} ${item.name} at ${nodes[item.node].name}`);
      this.world.add(group);
      return { group, node: item.node };
    };
    this.arrows = [
      ...accelerometers.map((item) => arrow(item, ACCELERATION, 0.12 * this.size, "accelerometer")),
      ...floor.map((item) => arrow(item, FLOOR, 0.075 * this.size, "floor input")),
    ];
    // The base: a foot under every node that it carries.
    for (const node of nodes.filter((n) => n.body === null && !n.free)) {
      const foot = new THREE.Mesh(new THREE.BoxGeometry(3.4 * thin, 3.4 * thin, 0.9 * thin), this.material(0x88929a));
      foot.position.set(node.at[0], node.at[1], node.at[2] - 0.45 * thin);
      this.says(foot, `foot ${node.name}, on the base`);
      this.world.add(foot);
    }
  }

  /// Puts everything where it is at `factor` times the amplitude.
  pose(factor) {
    const { nodes, beams, bodies } = this.scene;
    const mode = this.mode === null ? null : this.modes[this.mode];
    const scale = mode ? (factor * this.amplitude * this.size) / this.largest[this.mode] : 0;
    const at = nodes.map((node) => {
      const shape = mode ? this.shapeAt(mode, node) : [0, 0, 0];
      return new THREE.Vector3(...node.at.map((x, i) => x + scale * shape[i]));
    });
    this.bodies.forEach((group, index) => {
      const motion = mode ? mode.shape[index].motion.map((x) => x * scale) : [0, 0, 0, 0, 0, 0];
      const [x, y, z, a, b, c] = motion;
      const cog = bodies[index].cog;
      // First order, as the model is.
      group.matrix.set(1, -c, b, cog[0] + x, c, 1, -a, cog[1] + y, -b, a, 1, cog[2] + z, 0, 0, 0, 1);
      group.matrixWorldNeedsUpdate = true;
    });
    const between = (object, ends) => {
      const [p, q] = ends.map((end) => at[end]);
      const along = q.clone().sub(p);
      const length = along.length();
      object.position.copy(p).add(q).multiplyScalar(0.5);
      object.quaternion.setFromUnitVectors(new THREE.Vector3(0, 1, 0), along.normalize());
      object.scale.set(1, length, 1);
    };
    this.beams.forEach((group, index) => between(group, beams[index].ends));
    for (const { spring, ends, joint } of this.springs) {
      if (joint) spring.position.copy(at[ends[0]]).add(at[ends[1]]).multiplyScalar(0.5);
      else between(spring, ends);
    }
    for (const { cube, node } of this.masses) cube.position.copy(at[node]);
    for (const { group, node } of this.arrows) group.position.copy(at[node]);
    this.factor = factor;
    this.draw();
  }

  draw() {
    this.renderer.render(this.world, this.camera);
    const width = this.host.clientWidth, height = this.host.clientHeight;
    // A name that would lie on another one waits until there is room.
    const taken = [];
    for (const { element, position, size: [wide, high] } of this.labels) {
      const p = position().project(this.camera);
      const [x, y] = [((p.x + 1) / 2) * width + 8, ((1 - p.y) / 2) * height - 9];
      const free = taken.every(([a, b, c, d]) => x >= a + c || a >= x + wide || y >= b + d || b >= y + high);
      element.style.visibility = free ? "" : "hidden";
      if (free) taken.push([x, y, wide, high]);
      element.style.transform = `translate(${x}px, ${y}px)`;
    }
  }

  resize() {
    const width = this.host.clientWidth, height = this.host.clientHeight;
    if (!width || !height) return;
    this.camera.aspect = width / height;
    this.camera.updateProjectionMatrix();
    this.renderer.setSize(width, height);
    this.draw();
  }

  point(event) {
    const box = this.renderer.domElement.getBoundingClientRect();
    const x = event.clientX - box.left, y = event.clientY - box.top;
    const ray = new THREE.Raycaster();
    ray.setFromCamera(new THREE.Vector2((2 * x) / box.width - 1, 1 - (2 * y) / box.height), this.camera);
    const hit = ray.intersectObjects(this.picked, false)[0];
    this.tip.style.display = hit ? "block" : "none";
    if (hit) {
      this.tip.textContent = hit.object.userData.text;
      this.tip.style.left = `${x + 14}px`;
      this.tip.style.top = `${y + 10}px`;
    }
  }

  names(shown) {
    for (const { element } of this.labels) element.style.display = shown ? "" : "none";
  }

  /// Shows mode `index` moving, or the machine at rest if null.
  show(index) {
    this.mode = index;
    this.phase = Math.PI / 2;
    this.pose(index === null ? 0 : 1);
  }

  /// A small picture of every mode at its widest.
  pictures() {
    this.renderer.setPixelRatio(1);
    this.renderer.setSize(280, 210, false);
    this.camera.aspect = 4 / 3;
    this.camera.updateProjectionMatrix();
    const pictures = this.modes.map((_, index) => {
      this.show(index);
      return this.renderer.domElement.toDataURL("image/webp", 0.9);
    });
    this.renderer.setPixelRatio(Math.min(window.devicePixelRatio, 2));
    this.resize();
    return pictures;
  }

  /// Gives back what the browser has few of.
  end() {
    this.ended = true;
    this.observer.disconnect();
    this.renderer.dispose();
    this.renderer.forceContextLoss();
  }

  run() {
    let last = performance.now();
    const step = (now) => {
      if (this.ended) return;
      if (this.playing && this.mode !== null && !on_paper()) {
        this.phase += (2 * Math.PI * 0.6 * (now - last)) / 1000;
        this.pose(Math.sin(this.phase));
      }
      last = now;
      requestAnimationFrame(step);
    };
    requestAnimationFrame(step);
  }
}
