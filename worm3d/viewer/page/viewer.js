"use strict";
// The page around meshcat's scene: playback, cameras, layers. Positions are [x, y, z] with z up, in metres, as in the
// simulator; three.js has y up. Everything works on a file opened without a network.
(async function () {
  const element = (id) => document.getElementById(id);
  const guest = window.name === "worm3d-guest"; // one of several pages in another, which plays them (beside.js)

  function trouble(sentence) {
    element("trouble").textContent = sentence;
    element("trouble").hidden = false;
    document.documentElement.dataset.state = "failed";
  }

  window.addEventListener("error", (event) => trouble("The viewer stopped: " + event.message));
  window.addEventListener("unhandledrejection", (event) => trouble("The viewer stopped: " + event.reason.message));

  function bytes(text) {
    const raw = atob(text);
    const result = new Uint8Array(raw.length);
    for (let i = 0; i < raw.length; i++) result[i] = raw.charCodeAt(i);
    return result;
  }

  // ---------------------------------------------------------------- the data
  /** The byte strings in another: each follows its length. */
  function split(data) {
    const lengths = new DataView(data), parts = [];
    for (let at = 0, end = 0; at < data.byteLength; at = end) {
      end = at + 4 + lengths.getUint32(at, true);
      parts.push(new Uint8Array(data.slice(at + 4, end)));
    }
    return parts;
  }

  /** The byte strings of a compressed text. */
  async function unpacked(text) {
    const packed = new Blob([bytes(text)]).stream().pipeThrough(new DecompressionStream("deflate"));
    return split(await new Response(packed).arrayBuffer());
  }

  const text_of = (name) => element(name).textContent, form = element("scene").dataset.form;
  const small = form === "packed", feed = form === "live" ? await window.worm3d_feed(split, trouble) : null;
  if (small && typeof DecompressionStream === "undefined") {
    trouble("This page needs a browser of 2023 or later.");
    return;
  }
  const arrays = feed ? feed.arrays : small ? await unpacked(text_of("scene")) : [];
  const messages = feed ? feed.messages : small ? await unpacked(text_of("commands")) : text_of("commands").split("\n").filter(Boolean).map(bytes);
  const scene = JSON.parse(arrays.length ? new TextDecoder().decode(arrays[0]) : text_of("scene"));
  const floats = (array) => new Float32Array((arrays.length ? arrays[array] : bytes(array)).buffer);
  const data = feed ? feed.data : stored();
  const begin = () => (data.length ? data.time(0) : 0), end = () => (data.length ? data.time(data.length - 1) : 0);

  /** The frames of a finished run: the time of each, and its fields by name. */
  function stored() {
    const time = floats(scene.time), columns = {};
    for (const name of ["centre", "eye", "look", "azimuth", "speed", "reference_speed", "strain", "load"]) {
      if (scene[name] !== undefined && scene[name] !== null) columns[name] = floats(scene[name]);
    }
    if (scene.skin) Object.assign(columns, { sections: floats(scene.skin.sections), tint: floats(scene.skin.tint) });
    return {
      length: time.length,
      time: (k) => time[k],
      has: (name) => name in columns,
      get(name, k) {
        const count = columns[name].length / time.length;
        return columns[name].subarray(k * count, (k + 1) * count);
      },
    };
  }

  // ---------------------------------------------------------------- the scene
  if (typeof MeshCat === "undefined") {
    const player = document.querySelector("script[src]");
    trouble("The viewer's script is missing. This page needs the file " + (player && player.getAttribute("src")) + ".");
    return;
  }
  let viewer;
  try {
    viewer = new MeshCat.Viewer(element("meshcat-pane"), true, feed ? feed.renderer(element("meshcat-pane")) : undefined);
  } catch (error) {
    trouble("This page needs WebGL, which this browser does not offer: switch on hardware acceleration, or take another browser.");
    return;
  }
  // In order and at once: the animation must find the objects it moves.
  for (const message of messages) viewer.handle_command_bytearray(message);
  const animator = feed ? null : viewer.animator;
  if (animator) {
    animator.pause();
    // Only actions that play have an effect; the time is set by hand below.
    for (const action of animator.actions) action.play();
  }
  window.viewer = viewer;

  function layer(name) {
    return viewer.scene_tree.find(["meshcat", name]).object;
  }

  let solid = [];

  function find_ground() {
    solid = [];
    layer("world").traverse((part) => { if (part.isMesh && part.material.opacity === 1) solid.push(part); });
  }

  // ---------------------------------------------------------------- the skin
  // Each vertex is a sum of the points of four cross-sections, with weights that never change.
  const skin = scene.skin && make_skin(scene.skin);

  function make_skin({ along, around, left }) {
    const count = data.get("sections", 0).length / 18, corners = around.length, sides = corners - 1;
    const mesh = layer("skin").getObjectByProperty("isMesh", true), geometry = mesh.geometry;
    mesh.frustumCulled = false; // its bounds move
    const position = geometry.attributes.position.array, paint = geometry.attributes.color.array;
    const outlines = new Float32Array(3 * count * corners), shades = new Float32Array(3 * count * corners);
    const section = new Float32Array(18), sides_colours = new Float32Array(6);

    function mixed(result, name, first, k, next, share) {
      const before = data.get(name, k), after = data.get(name, next);
      for (let i = 0; i < result.length; i++) result[i] = (1 - share) * before[first + i] + share * after[first + i];
    }

    function outline(s, k, next, share) {
      mixed(section, "sections", 18 * s, k, next, share);
      mixed(sides_colours, "tint", 6 * s, k, next, share);
      for (let c = 0; c < corners; c++) {
        for (let x = 0; x < 3; x++) {
          let sum = 0;
          for (let a = 0; a < 6; a++) sum += around[c][a] * section[3 * a + x];
          const to = 3 * (s * corners + c) + x;
          outlines[to] = sum;
          shades[to] = left[c] * sides_colours[x] + (1 - left[c]) * sides_colours[3 + x];
        }
      }
    }

    /** Along the worm, between the sections s + 1 and s + 2, and the same for the colours. */
    function ring(to, s, weights) {
      const step = 3 * corners, from = s * step;
      for (let i = 0; i < 3 * sides; i++) {
        let place = 0, shade = 0;
        for (let m = 0; m < 4; m++) {
          place += weights[m] * outlines[from + m * step + i];
          shade += weights[m] * shades[from + m * step + i];
        }
        position[to + i] = place;
        paint[to + i] = Math.min(Math.max(shade, 0), 1);
      }
    }

    function tip(to, s) {
      const from = 3 * (s * corners + sides);
      for (let x = 0; x < 3; x++) { position[to + x] = outlines[from + x]; paint[to + x] = shades[from + x]; }
    }

    return {
      mesh,
      bend(k, next, share) {
        for (let s = 0; s < count; s++) outline(s, k, next, share);
        let to = 0;
        for (let s = 0; s < count - 3; s++) for (const weights of along) { ring(to, s, weights); to += 3 * sides; }
        ring(to, count - 4, [0, 0, 1, 0]);
        to += 3 * sides;
        tip(to, 1);
        tip(to + 3, count - 2);
        geometry.attributes.position.needsUpdate = geometry.attributes.color.needsUpdate = true;
        geometry.computeVertexNormals();
      },
    };
  }

  // ---------------------------------------------------------------- vectors
  const three = (v) => new MeshCat.THREE.Vector3(v[0], v[2], -v[1]);
  const vertical = new MeshCat.THREE.Vector3(0, 1, 0);
  const plus = (a, b, factor) => a.map((x, i) => x + factor * b[i]);
  const up = [0, 0, 1];
  const ahead = scene.heading;
  const left = [-ahead[1], ahead[0], 0];

  /** Index k and share s in [0, 1] with now = time[k] + s (time[k + 1] - time[k]). */
  function between(now) {
    let low = 0, high = data.length - 1;
    while (high - low > 1) {
      const middle = (low + high) >> 1;
      if (data.time(middle) <= now) low = middle; else high = middle;
    }
    const step = data.time(high) - data.time(low);
    return [low, high, step > 0 ? Math.min(Math.max((now - data.time(low)) / step, 0), 1) : 0];
  }

  /** A field of the frames, at an instant. */
  function at(name, now) {
    const [k, next, share] = between(now), before = data.get(name, k), after = data.get(name, next);
    return Array.from(before, (value, i) => (1 - share) * value + share * after[i]);
  }

  /** A horizontal vector, turned to the left. */
  const turned = (v, angle) => [Math.cos(angle) * v[0] - Math.sin(angle) * v[1], Math.sin(angle) * v[0] + Math.cos(angle) * v[1], v[2]];

  // ---------------------------------------------------------------- cameras
  const size = scene.size;
  const turns = Boolean(feed) || Array.from({ length: data.length }, (_, k) => data.get("azimuth", k)[0]).some((angle) => Math.abs(angle) > 0.3);
  let preset = "", follows = null;

  /** Where the worm is, and how far it has turned: what cameras that follow it keep to. */
  const pose = (turns_too) => ({ place: at("centre", now), angle: turns_too ? at("azimuth", now)[0] : 0, turns_too });

  /** Pixels that the panel covers on the left, the bar below, and plots and controls on the right. */
  function covered() {
    const panel = element("panel").getBoundingClientRect(), bar = element("bar"), side = element("side").getBoundingClientRect();
    const wide = window.innerWidth > 1.8 * panel.right && window.innerWidth > 900;
    const seen = element("panel").open && !element("panel").hidden && window.innerWidth > 1.8 * panel.right;
    return [seen ? panel.right : 0, bar.hidden ? 0 : 60, wide && side.height > 100 ? side.width : 0];
  }

  /** Put the middle of the picture into the middle of what is not covered. */
  function centre_view() {
    const [panel, bar, side] = covered(), wide = window.innerWidth, high = window.innerHeight;
    viewer.camera.setViewOffset(wide, high, (side - panel) / 2, bar / 2, wide, high);
    viewer.set_dirty();
  }

  function aim(from, to) {
    viewer.camera.position.copy(three(from));
    viewer.controls.target.copy(three(to));
    viewer.controls.update();
    viewer.set_dirty();
  }

  /** Where to look, and how wide and high: the whole run, or two bodies that follow the worm. */
  function window_of(rises) {
    const spread = scene.low.map((x, i) => scene.high[i] - x); // ahead, left, up
    const long = spread[0], high = spread[rises], deep = spread[3 - rises];
    const whole = Math.max(long, high) <= 3.2 * size && (rises === 1 || (!turns && deep < size));
    const middle = [ahead, left, up].reduce(
      (sum, axis, i) => plus(sum, axis, 0.5 * (scene.low[i] + scene.high[i])), [0, 0, 0]);
    return {
      to: whole ? middle : at("centre", now),
      width: (whole ? long : (rises === 2 ? 1.4 : 2.2) * size) + 0.3 * size,
      height: (whole ? high : (rises === 2 ? Math.max(0.5 * size, scene.tall) : 1.2 * size)) + 0.4 * size,
      moves: !whole,
    };
  }

  function flat(from, rises, slant) {
    const view = window_of(rises);
    // The panel and the bar take some of the window.
    const free = Math.max((window.innerWidth - covered()[0] - covered()[2]) / window.innerHeight, 0.3);
    const distance = Math.max(view.width / free, view.height / 0.8) / (2 * Math.tan(viewer.camera.fov * Math.PI / 360));
    const here = pose(rises === 2);
    const towards = view.moves ? turned(from, here.angle) : from;
    follows = view.moves ? here : null;
    aim(plus(plus(view.to, towards, distance), slant, 1e-3 * distance), view.to);
  }

  const cameras = {
    // From a little above the ground, so that it is seen.
    side: () => flat(left.map((x, i) => 0.14 * up[i] - x), 2, [0, 0, 0]),
    top: () => flat(up, 1, left.map((x) => -x)),
    follow: () => {
      const far = Math.max(1.2 * scene.tall, 0.9 * size) * Math.max(1, 1.3 * window.innerHeight / (window.innerWidth - covered()[0] - covered()[2]));
      follows = pose(true);
      const from = turned(plus(plus([0, 0, 0], ahead, -0.75), left, -1.35), follows.angle);
      aim(plus(plus(follows.place, from, far), up, 0.75 * far), follows.place);
    },
    inside: () => { follows = null; },
  };
  const titles = {
    side: "from the right of the worm", top: "from above",
    follow: "from behind, moving and turning along with the worm", inside: scene.centreline ? "inside the pipe, from ahead of the worm" : "from ahead of the worm",
  };
  const labels = { inside: scene.centreline ? "inside" : "front" };

  function choose(name) {
    preset = name;
    below = name === "inside";
    cameras[name]();
    clear_sight();
    if (name === "inside") aim(at("eye", now), at("look", now));
    for (const button of element("cameras").querySelectorAll("button")) {
      button.setAttribute("aria-pressed", String(button.value === name));
    }
  }

  /** The camera inside stands on the path, which would fill the picture. */
  function clear_sight() {
    const box = element("layers").querySelector('input[value="path"]');
    if (box) layer("path").visible = box.checked && preset !== "inside";
  }

  function carry() {
    if (preset === "inside") {
      aim(at("eye", now), at("look", now));
    } else if (follows) {
      const to = pose(follows.turns_too), angle = to.angle - follows.angle;
      for (const point of [viewer.camera.position, viewer.controls.target]) {
        point.sub(three(follows.place)).applyAxisAngle(vertical, angle).add(three(to.place));
      }
      follows = to;
      viewer.controls.update();
    }
  }

  // ---------------------------------------------------------------- the floor
  const rays = new MeshCat.THREE.Raycaster();
  let lifting = false, below = false; // below: where it was set inside a pipe

  /** How high the ground is there: what one cannot see through, or beyond its edge a plane through it. */
  function floor_at(x, y) {
    rays.set(three([x, y, 1e3 * size]), new MeshCat.THREE.Vector3(0, -1, 0));
    const hit = rays.intersectObjects(solid)[0];
    return hit ? hit.point.y : scene.floor[0] + scene.floor[1] * x + scene.floor[2] * y;
  }

  /** Keep the camera above the ground, as far from what it looks at as it was. */
  function keep_above() {
    if (!scene.floor || lifting || below) return;
    const place = viewer.camera.position, to = viewer.controls.target, away = place.distanceTo(to);
    for (let again = 0; again < 3; again++) { // the ground is not level
      const least = floor_at(place.x, -place.z) + 0.04 * size;
      if (place.y >= least) break;
      place.y = least;
      const flat = Math.hypot(place.x - to.x, place.z - to.z), wanted = Math.sqrt(Math.max(away ** 2 - (least - to.y) ** 2, 1e-6 * away ** 2));
      if (flat > 0) {
        place.x = to.x + (place.x - to.x) * wanted / flat;
        place.z = to.z + (place.z - to.z) * wanted / flat;
      }
    }
    lifting = true;
    viewer.controls.update();
    lifting = false;
  }

  function see_far() {
    viewer.camera.far = 100 * size + 2 * Math.hypot(...scene.low.map((x, i) => scene.high[i] - x));
    viewer.camera.updateProjectionMatrix();
  }

  function make_cameras() {
    viewer.camera.fov = 35;
    viewer.camera.near = 0.005 * size;
    see_far();
    for (const name of Object.keys(cameras)) {
      const button = document.createElement("button");
      Object.assign(button, { type: "button", value: name, textContent: labels[name] || name, title: titles[name] });
      button.addEventListener("click", () => choose(name));
      element("cameras").append(button);
    }
    window.addEventListener("resize", centre_view);
    element("panel").addEventListener("toggle", centre_view);
    viewer.controls.addEventListener("change", keep_above);
    viewer.controls.addEventListener("start", () => {
      if (preset === "inside") preset = "";
      clear_sight();
    });
  }

  // ---------------------------------------------------------------- shadows
  // They show what touches the ground, and what hangs above it.
  const sun = viewer.scene_tree.find(["Lights", "Sun", "<object>"]).object;
  const to_sun = [-0.9, -1.4, 2.6];

  function make_shadows() {
    const reach = 0.8 * size, frustum = sun.shadow.camera;
    if (!viewer.renderer.shadowMap.enabled) return; // shadows take half of the time without a graphics card
    sun.castShadow = true;
    sun.shadow.mapSize.set(2048, 2048);
    sun.shadow.normalBias = 0.004 * size;
    Object.assign(frustum, { left: -reach, right: reach, bottom: -reach, top: reach, near: 0.1 * size, far: 8 * size });
    frustum.updateProjectionMatrix();
    viewer.scene.add(sun.target);
    for (const name of ["links", "chambers", "skin", "faces", "trail", "path", "forces", "anchors", "horizon", "world"]) {
      const casts = ["links", "chambers", "skin", "faces"].includes(name);
      layer(name).traverse((part) => { part.castShadow = casts; part.receiveShadow = casts || name === "world"; });
    }
  }

  /** The sun moves along: its shadows reach a worm's length only. */
  function shine() {
    const to = at("centre", now);
    sun.position.set(...plus(to, to_sun, size));
    sun.target.position.set(...to);
  }

  // ---------------------------------------------------------------- layers
  function show_layer(name, visible) {
    const box = element("layers").querySelector(`input[value="${name}"]`);
    if (!box) return;
    box.checked = visible;
    layer(name).visible = visible;
    if (feed) set_parts();
    clear_sight();
    see_through();
    viewer.set_dirty();
  }

  /** The skin hides what is below it, unless one wants to see that. */
  function see_through() {
    if (!skin) return;
    const clear = ["links", "chambers"].some((name) => layer(name).visible);
    Object.assign(skin.mesh.material, { opacity: clear ? 0.4 : 1, transparent: clear, depthWrite: !clear });
    skin.mesh.castShadow = true;
  }

  function make_layers() {
    for (const { name, label, colour, visible } of scene.layers) {
      const row = document.createElement("label");
      const box = document.createElement("input");
      const swatch = document.createElement("span");
      Object.assign(box, { type: "checkbox", value: name });
      swatch.className = "swatch";
      swatch.style.background = colour;
      box.addEventListener("change", () => show_layer(name, box.checked));
      row.append(box, swatch, label);
      element("layers").append(row);
      show_layer(name, visible);
    }
  }

  /** 0 is invisible, 0.5 as made, 1 opaque. */
  function world_opacity(share) {
    element("opacity").querySelector("input").value = share;
    layer("world").traverse((part) => {
      if (!part.material) return;
      if (part.userData.opacity === undefined) part.userData.opacity = part.material.opacity;
      const made = part.userData.opacity;
      const opacity = share <= 0.5 ? 2 * share * made : made + (1 - made) * (2 * share - 1);
      Object.assign(part.material, { opacity, transparent: opacity < 1, depthWrite: opacity >= 1 });
    });
    viewer.set_dirty();
  }

  function make_opacity() {
    if (scene.layers.some((one) => one.name === "world")) {
      element("opacity").querySelector("input").addEventListener("input", (event) => world_opacity(Number(event.target.value)));
    } else {
      element("opacity").remove();
    }
  }

  function make_legend() {
    const { strain, colours, force, arrow } = scene.legend;
    element("ramp").style.background = `linear-gradient(to right, ${colours.join(", ")})`;
    const ends = element("strain").querySelectorAll(".ends span");
    ends[0].textContent = `\u2212${Math.round(100 * strain)} %`;
    ends[2].textContent = `+${Math.round(100 * strain)} %`;
    if (force === null) element("forces").remove();
    else element("forces").textContent = `an arrow of ${rounded(arrow)} m is ${rounded(force)} N`;
  }

  const rounded = (value) => String(Number(value.toPrecision(3)));
  const metres_a_second = (value) => `${(Math.abs(value) < 1e-6 * size ? 0 : value).toPrecision(3)} m/s`;

  // ---------------------------------------------------------------- playback
  let now = 0, playing = false, rate = 1, last = null;

  /** Give all parts their poses at the present instant. */
  function set_parts() {
    const [k, next, share] = between(now);
    if (feed) {
      feed.pose(k, next, share, layer);
    } else {
      animator.seek(now);
      if (scene.trail) {
        const rings = scene.trail.rings[share > 0.999 ? next : k];
        viewer.scene_tree.find(["meshcat", "trail", "com", "<object>"]).object.geometry.setDrawRange(
          0, Math.max(rings - 1, 0) * scene.trail.faces * 3);
      }
    }
    if (skin && layer("skin").visible) skin.bend(k, next, share);
  }

  function show(instant) {
    now = Math.min(Math.max(instant, begin()), end());
    set_parts();
    carry();
    shine();
    const bar = element("time");
    if (feed) Object.assign(bar, { min: begin(), max: Math.max(end(), begin() + 1e-3) });
    bar.value = now;
    element("now").textContent = `${now.toFixed(2)} / ${end().toFixed(2)} s`;
    element("clock").textContent = `t = ${(scene.start + now).toFixed(2)} s`;
    if (data.has("speed")) element("speed").textContent = `speed ${metres_a_second(at("speed", now)[0])}`;
    if (feed) {
      element("mean").textContent = scene.period ? "mean of the last period" : "";
    } else if (data.has("speed") && scene.period) {
      const from = Math.max(now - scene.period / 2, 0), to = Math.min(now + scene.period / 2, end());
      element("mean").textContent = `mean of ${(scene.start + from).toFixed(2)} to ${(scene.start + to).toFixed(2)} s`;
    }
    if (data.has("reference_speed")) element("reference").textContent = `reference ${metres_a_second(at("reference_speed", now)[0])}`;
    document.documentElement.dataset.time = now.toFixed(3);
    tools.seen();
    viewer.set_dirty();
  }

  function play(on) {
    if (feed && feed.at_head()) { feed.hold(!on); return; }
    if (on && now >= end()) show(begin());
    playing = on && end() > begin();
    last = null;
    label_play(playing);
  }

  function label_play(on) {
    element("play").textContent = on ? "\u275A\u275A" : "\u25B6";
    element("play").setAttribute("aria-label", on ? "Pause" : "Play");
  }

  function tick(stamp) {
    requestAnimationFrame(tick);
    if (feed && feed.tick(stamp)) { show(end()); return; }
    if (playing) {
      const passed = last === null ? 0 : Math.min((stamp - last) / 1000, 0.25);
      last = stamp;
      const target = now + rate * passed;
      if (target < end()) show(target);
      else if (feed) { play(false); feed.follow(true); }
      else if (element("loop").checked) show(target - end());
      else { show(end()); play(false); }
    }
  }

  /** Only the scene, for a picture of it. */
  function bare(on) {
    element("panel").hidden = on;
    element("side").hidden = on;
    element("bar").hidden = on || guest || (!feed && end() === 0);
    centre_view();
    if (preset) choose(preset);
  }

  function make_bar() {
    element("time").max = end() || 1;
    element("time").addEventListener("input", (event) => go_to(Number(event.target.value)));
    element("play").addEventListener("click", () => play(element("play").getAttribute("aria-label") === "Play"));
    element("rate").addEventListener("change", (event) => {
      rate = Number(event.target.value);
      if (feed) feed.speed(rate);
    });
    const jump = feed ? go_to : show, step = () => (end() - begin()) / Math.max(data.length - 1, 1);
    make_keys({
      " ": () => element("play").click(),
      ArrowRight: () => jump(now + step()),
      ArrowLeft: () => jump(now - step()),
      Home: () => jump(begin()),
      End: () => (feed ? feed.follow(true) : show(end())),
      ...(feed ? feed.keys : {}),
    });
  }

  /** Look at an instant, which a live page does not leave until it is told to. */
  function go_to(instant) {
    if (feed) feed.follow(false);
    play(false);
    show(instant);
  }

  /** Keys are the page's, also after a click on the panel; who goes there by the Tab key operates it by keys. */
  function make_keys(does) {
    let tabbed = false;
    window.addEventListener("pointerdown", () => { tabbed = false; }, true);
    window.addEventListener("keydown", (event) => {
      if (event.key === "Tab") tabbed = true;
      if (event.target.matches("input[type=number], input[type=text]")) return;
      if (!does[event.key] || event.ctrlKey || event.altKey || event.metaKey) return;
      const focused = document.activeElement, controls = focused && focused.matches("input, select, button, summary");
      if (controls && tabbed && focused !== element("time")) return;
      if (controls && !tabbed) focused.blur();
      event.preventDefault();
      if (guest) window.parent.postMessage(event.key, "*");
      else does[event.key]();
    });
  }

  /** `viewer.html#t=2.5&camera=top&hide=links,world&show=skin&world=0.3&play=1&bare=1` */
  function obey(hash) {
    const asked = new URLSearchParams(hash.replace(/^#/, ""));
    const names = (key) => (asked.get(key) || "").split(",").filter(Boolean);
    if (asked.has("t")) show(Number(asked.get("t")) || 0);
    for (const name of names("hide")) show_layer(name, false);
    for (const name of names("show")) show_layer(name, true);
    if (asked.has("world")) world_opacity(Number(asked.get("world")));
    if (asked.has("bare")) bare(asked.get("bare") !== "0");
    if (cameras[asked.get("camera")]) choose(asked.get("camera"));
    if (asked.has("play")) play(asked.get("play") !== "0");
  }

  const page = {
    viewer, scene, data, layer, three, show, go_to, begin, end, element, guest, play, label_play, centre_view,
    now: () => now, playing: () => playing,
    play_past(on) { playing = on; last = null; },
    /** What a ray through a place of the window [pixels] meets first, of the layers named or all, or null. */
    hit(x, y, names) {
      const pane = element("meshcat-pane").getBoundingClientRect();
      rays.setFromCamera({ x: (2 * (x - pane.left)) / pane.width - 1, y: 1 - (2 * (y - pane.top)) / pane.height }, viewer.camera);
      const seen = [];
      for (const name of names) if (layer(name).visible) layer(name).traverseVisible((part) => { if (part.isMesh) seen.push(part); });
      return rays.intersectObjects(seen)[0] || null;
    },
    ray: () => rays.ray,
    /** Take over new surroundings. */
    surround() { find_ground(); see_far(); clear_sight(); world_opacity(Number(element("opacity").querySelector("input").value)); },
  };
  const tools = window.worm3d_tools(page);
  find_ground();
  if (feed) feed.attach(page);
  make_cameras();
  make_shadows();
  make_layers();
  make_opacity();
  make_legend();
  make_bar();
  element("panel").open = !guest && window.innerWidth > 560;
  element("bar").hidden = guest;
  viewer.set_3d_pane_size();
  centre_view();
  show(begin());
  choose("follow");
  if (!feed) play(false);
  obey(location.hash);
  window.addEventListener("hashchange", () => obey(location.hash));
  requestAnimationFrame(tick);
  document.documentElement.dataset.state = "ready";
  if (guest) {
    window.addEventListener("message", (event) => { if (event.source === window.parent) obey(String(event.data)); });
    window.parent.postMessage("ready", "*");
  }
})();
