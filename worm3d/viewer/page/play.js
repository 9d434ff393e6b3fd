"use strict";
// The stream of a live page, and the controls of its run. Rows are frames as `worm3d.viewer.stream` makes them; older
// rows are thinned out, so that the page keeps what was seen so far in limited memory.
(function () {
  const MOST_ROWS = 3000, MOST_BYTES = 24e6, MOST_RINGS = 1500, PULL_EVERY = 30, STEER_EVERY = 120, SET_EVERY = 80; // [ms]
  const text = (bytes) => new TextDecoder().decode(bytes);

  /** Resolve to the feed of the page as soon as a scene has come. */
  window.worm3d_feed = (split, trouble) => new Promise((resolve) => {
    let socket, rows = [], fields = {}, scene = null, world = null, page = null, state = {}, number = 0;
    let following = true, fresh = false, rings = [], ring_time = [];
    const three = () => MeshCat.THREE;

    // -------------------------------------------------------------- messages
    function connect() {
      socket = new WebSocket(`ws://${location.host}${location.pathname}socket`);
      socket.binaryType = "arraybuffer";
      socket.onmessage = ({ data }) => {
        const kind = text(data.slice(0, 4));
        if (kind in takes) takes[kind](data.slice(4));
      };
      socket.onclose = () => {
        if (page) say("Not connected: the run has ended, or its program was stopped. What was seen can still be played.");
        setTimeout(connect, 1000);
      };
    }

    const send = (message) => {
      if (socket.readyState === 1) socket.send(JSON.stringify({ ...message, id: ++number }));
      return number;
    };

    const takes = {
      scen(data) {
        const [about, commands] = split(data), arrays = split(about.buffer), found = JSON.parse(text(arrays[0]));
        const same = scene && JSON.stringify([scene.fields, scene.controls]) === JSON.stringify([found.fields, found.controls]);
        if (page && !same) { location.reload(); return; }
        rows = [];
        rings = [];
        ring_time = [];
        drawn = 0;
        fresh = false;
        scene = found;
        fields = found.fields;
        if (!page) Object.assign(feed, { arrays, messages: split(commands.buffer) });
      },
      worl(data) {
        const [about, commands] = split(data);
        world = { about: JSON.parse(text(split(about.buffer)[0])), messages: split(commands.buffer) };
        if (page) surround();
      },
      fram: (data) => add(new Float32Array(data)),
      many(data) {
        const size = Object.values(fields).reduce((sum, [, count]) => sum + count, 0) * 4;
        for (let at = 0; at < data.byteLength; at += size) add(new Float32Array(data.slice(at, at + size)));
      },
      stat(data) {
        state = JSON.parse(text(data));
        if (page) tell();
      },
    };

    function add(row) {
      const last = rows[rows.length - 1];
      if (last && row[0] <= last[0]) rows.pop();
      rows.push(row);
      if (rows.length > Math.min(MOST_ROWS, MOST_BYTES / row.byteLength)) {
        const half = rows.length >> 1;
        rows = rows.filter((_, k) => k >= half || k % 2 === 0);
      }
      add_ring(row);
      fresh = true;
      if (!page && world && scene) resolve(feed);
    }

    // -------------------------------------------------------------- frames
    const part = (row, name) => row.subarray(fields[name][0], fields[name][0] + fields[name][1]);
    const data = {
      get length() { return rows.length; },
      time: (k) => rows[k][0],
      has: (name) => name in fields,
      get: (name, k) => part(rows[k], name),
    };

    const targets = {};

    /** Objects of a layer, which are there from the start. */
    function objects(name) {
      targets[name] = targets[name] || scene.paths[name].map((path) => {
        const found = page.viewer.scene_tree.find(["meshcat", ...path.split("/")]);
        return { object: found.object, mesh: found.object.getObjectByProperty("isMesh", true) };
      });
      return targets[name];
    }

    function pose(k, next, share, layer) {
      const a = rows[k], b = rows[next], from = new (three().Quaternion)();
      for (const name of Object.keys(scene.paths)) {
        if (!layer(name).visible) continue;
        const all = ["position", "quaternion", "scale", "tint"].map((field) => fields[`${name}.${field}`]);
        const stepped = name === "anchors" ? (share > 0.999 ? 1 : 0) : share;
        objects(name).forEach(({ object, mesh }, i) => {
          const [place, turn, scale, tint] = all, mixed = (first, x, by) => (1 - by) * a[first + x] + by * b[first + x];
          if (scale) {
            const first = scale[0] + 3 * i;
            object.scale.set(mixed(first, 0, stepped), mixed(first, 1, stepped), mixed(first, 2, stepped));
            object.visible = object.scale.y > 1e-5;
            if (!object.visible) return;
          }
          object.position.set(...[0, 1, 2].map((x) => mixed(place[0] + 3 * i, x, share)));
          if (turn) {
            object.quaternion.fromArray(a, turn[0] + 4 * i);
            if (share > 0) object.quaternion.slerp(from.fromArray(b, turn[0] + 4 * i), share);
          }
          if (tint && mesh) mesh.material.color.setRGB(...[0, 1, 2].map((x) => mixed(tint[0] + 3 * i, x, share)));
        });
      }
      if (layer("trail").visible) draw_trail((1 - share) * a[0] + share * b[0]);
      draw_spring(share > 0.5 ? b : a);
      if (fields.heard) document.documentElement.dataset.heard = part(share > 0.5 ? b : a, "heard")[0];
    }

    // -------------------------------------------------------------- the trail
    let trail = null, drawn = 0;

    function add_ring(row) {
      const place = part(row, "ring"), before = rings[rings.length - 1];
      if (before && Math.hypot(place[0] - before[0], place[1] - before[1], place[2] - before[2]) < scene.trail.ring) return;
      rings.push(place.slice());
      ring_time.push(row[0]);
      if (rings.length > MOST_RINGS) {
        [rings, ring_time] = [rings, ring_time].map((list) => list.filter((_, k) => k % 2 === 0));
        drawn = 0;
      }
    }

    function make_trail() {
      const mesh = page.layer("trail").getObjectByProperty("isMesh", true), sides = 6, faces = [];
      for (let k = 0; k + 1 < MOST_RINGS + 2; k++) {
        for (let i = 0; i < sides; i++) {
          const a = k * sides + i, b = k * sides + ((i + 1) % sides);
          faces.push(a, b, b + sides, a, b + sides, a + sides);
        }
      }
      const geometry = new (three().BufferGeometry)(), floats = () => new (three().BufferAttribute)(new Float32Array(18 * (MOST_RINGS + 2)), 3);
      geometry.setAttribute("position", floats());
      geometry.setAttribute("normal", floats());
      geometry.setIndex(faces);
      mesh.geometry = geometry;
      mesh.frustumCulled = false;
      trail = geometry;
    }

    /** The rings that the worm has passed. */
    function draw_trail(now) {
      if (drawn > rings.length) drawn = 0;
      const { position, normal } = trail.attributes;
      if (drawn < rings.length) {
        for (let k = drawn; k < rings.length; k++) {
          for (let x = 0; x < 18; x++) {
            const middle = (rings[k][x % 3] + rings[k][6 + (x % 3)] + rings[k][12 + (x % 3)]) / 3;
            position.array[18 * k + x] = rings[k][x];
            normal.array[18 * k + x] = rings[k][x] - middle;
          }
        }
        position.needsUpdate = normal.needsUpdate = true;
        drawn = rings.length;
      }
      let passed = rings.length;
      while (passed > 0 && ring_time[passed - 1] > now) passed--;
      trail.setDrawRange(0, Math.max(passed - 1, 0) * 36);
    }

    // -------------------------------------------------------------- the spring that pulls the worm
    let spring = null, pulled = null, aim = null;

    function make_spring() {
      const material = new (three().MeshBasicMaterial)({ color: 0xd9480f, depthTest: false, transparent: true });
      spring = new (three().Mesh)(new (three().CylinderGeometry)(1, 1, 1, 6), material);
      spring.renderOrder = 2;
      page.viewer.scene.add(spring);
    }

    function draw_spring(row) {
      const values = fields.push ? part(row, "push") : [0, 0, 0, 0, 0, 0, 0], force = values[6], tag = page.element("tag");
      spring.visible = force > 0;
      tag.hidden = !spring.visible;
      if (!spring.visible) return;
      const a = new (three().Vector3)(...values.slice(0, 3)), b = new (three().Vector3)(...values.slice(3, 6)), thick = 0.006 * scene.size;
      spring.position.copy(a).add(b).multiplyScalar(0.5);
      spring.quaternion.setFromUnitVectors(new (three().Vector3)(0, 1, 0), b.clone().sub(a).normalize());
      spring.scale.set(thick, a.distanceTo(b), thick);
      tag.textContent = `${Number(force.toPrecision(2))} N`;
      page.place_tag(page.three(values.slice(3, 6)));
    }

    /** The place under the pointer in the plane through the grabbed point that faces the camera. */
    function under(event) {
      page.hit(event.clientX, event.clientY, []);
      const place = page.ray().intersectPlane(pulled, new (three().Vector3)());
      return place && [place.x, -place.z, place.y];
    }

    function make_pull() {
      const pane = page.element("meshcat-pane");
      pane.addEventListener("pointerdown", (event) => {
        if (!(event.ctrlKey || event.metaKey || page.element("pull").getAttribute("aria-pressed") === "true") || event.button !== 0) return;
        const hit = page.hit(event.clientX, event.clientY, ["skin", "chambers", "links", "faces"]);
        if (!hit) return;
        event.stopPropagation();
        event.preventDefault();
        follow(true);
        const facing = page.viewer.camera.getWorldDirection(new (three().Vector3)());
        pulled = new (three().Plane)().setFromNormalAndCoplanarPoint(facing, hit.point);
        pane.setPointerCapture(event.pointerId);
        send({ do: "grab", value: [hit.point.x, -hit.point.z, hit.point.y] });
      }, true);
      pane.addEventListener("pointermove", (event) => {
        if (!pulled) return;
        const first = !aim;
        aim = under(event);
        if (first && aim) setTimeout(() => { if (pulled && aim) send({ do: "pull", value: aim }); aim = null; }, PULL_EVERY);
      }, true);
      for (const name of ["pointerup", "pointercancel"]) {
        window.addEventListener(name, () => { if (pulled) { pulled = null; send({ do: "let_go" }); } }, true);
      }
      window.addEventListener("blur", () => { if (pulled) { pulled = null; send({ do: "let_go" }); } });
    }

    // -------------------------------------------------------------- surroundings
    function surround() {
      Object.assign(scene, world.about);
      for (const name of ["world", "path"]) page.viewer.scene_tree.find(["meshcat"]).object.children
        .filter((child) => child.name === name).forEach((child) => child.traverse((one) => { if (one.geometry) one.geometry.dispose(); }));
      for (const name of ["world", "path"]) {
        const node = page.viewer.scene_tree.find(["meshcat", name]);
        for (const child of Object.keys(node.children)) node.delete([child]);
      }
      for (const message of world.messages) page.viewer.handle_command_bytearray(message);
      page.layer("world").traverse((one) => { one.receiveShadow = true; one.castShadow = false; });
      cheapen();
      page.surround();
    }

    // -------------------------------------------------------------- state and controls
    const inputs = {}, waiting = {};
    let told = "", hide = 0;

    function say(sentence) {
      const line = page.element("told");
      line.textContent = sentence;
      line.hidden = !sentence;
      clearTimeout(hide);
      hide = setTimeout(() => { line.hidden = true; }, 10000);
    }

    function tell() {
      if (following) page.label_play(!state.held);
      const rate = page.element("rate");
      if ([...rate.options].some((option) => Number(option.value) === state.speed)) rate.value = state.speed;
      const refused = state.says && state.says !== told; // a slider goes back, also under the pointer
      if (state.says !== undefined && state.says !== told) say(told = state.says);
      for (const [key, value] of Object.entries(state.values || {})) {
        for (const input of inputs[key] || []) if (refused || (document.activeElement !== input && !(key in waiting))) input.value = shown(value);
      }
      const record = page.element("record");
      if (record) {
        record.setAttribute("aria-pressed", String(Boolean(state.recording)));
        record.textContent = state.recording ? "stop recording" : "record";
        page.element("steered").textContent = state.steered || "";
      }
    }

    const shown = (value) => (typeof value === "number" ? Number(value.toPrecision(4)) : value);

    /** Send the latest value of a key, at most once in a while. */
    function set(key, value) {
      const first = !(key in waiting);
      waiting[key] = value;
      if (first) setTimeout(() => { send({ do: "set", key, value: waiting[key] }); delete waiting[key]; }, SET_EVERY);
    }

    function button(name, label, title, does) {
      const made = document.createElement("button");
      Object.assign(made, { type: "button", id: name, textContent: label, title });
      made.addEventListener("click", does);
      return made;
    }

    function row_of({ key, value, low, high, unit, meaning, choices }) {
      const row = document.createElement("label"), name = document.createElement("span");
      name.textContent = unit && unit !== "1" ? `${key} [${unit}]` : key;
      row.title = meaning;
      if (choices) {
        const chosen = document.createElement("select");
        for (const each of choices) chosen.append(new Option(each, each));
        chosen.value = value;
        chosen.addEventListener("change", () => set(key, chosen.value));
        inputs[key] = [chosen];
      } else {
        const slider = document.createElement("input"), number = document.createElement("input");
        Object.assign(slider, { type: "range", min: low, max: high, step: "any", value, name: key });
        Object.assign(number, { type: "number", step: "any", value: shown(value) });
        slider.addEventListener("input", () => { number.value = shown(Number(slider.value)); set(key, Number(slider.value)); });
        number.addEventListener("change", () => { slider.value = number.value; set(key, Number(number.value)); });
        inputs[key] = [slider, number];
      }
      row.append(name, ...inputs[key]);
      return row;
    }

    function make_controls({ keys, steers }) {
      const box = document.createElement("details"), title = document.createElement("summary"), buttons = document.createElement("div");
      Object.assign(box, { id: "controls", className: "box", open: window.innerWidth > 560 });
      title.textContent = "Controls";
      const pull = button("pull", "pull", "drag the worm to pull it; or hold ctrl and drag", () => {
        pull.setAttribute("aria-pressed", String(pull.getAttribute("aria-pressed") !== "true"));
      });
      buttons.append(
        pull,
        button("record", "record", "make a folder of results, as worm3d run does", () => send({ do: "record" })),
        button("save", "save", "save the scene with these values", () => send({ do: "save" })),
      );
      const help = document.createElement("p"), steered = document.createElement("p"), list = document.createElement("div");
      help.textContent = `ctrl-drag pulls the worm. ${steers}`;
      steered.id = "steered";
      list.append(...keys.map(row_of));
      box.append(title, buttons, help, steered, list);
      box.addEventListener("toggle", page.centre_view);
      page.element("side").prepend(box);
      make_pull();
      if (!steers) return;
      const last = {}; // a key that is held down repeats itself
      const steer = (value) => () => {
        if (performance.now() - last[value] < STEER_EVERY) return;
        last[value] = performance.now();
        follow(true);
        send({ do: "steer", value });
      };
      Object.assign(feed.keys, { ArrowLeft: steer([1, 0]), ArrowRight: steer([-1, 0]), ArrowUp: steer([0, 1]), ArrowDown: steer([0, -1]) });
      feed.keys.Escape = () => send({ do: "unsteer" });
    }

    function make_buttons() {
      page.element("play").title = "Pause or go on (space); a dot takes a step; Home goes to the start of what was seen, End to the present";
      page.element("loop").parentElement.remove();
      page.element("play").after(
        button("step", "\u25B6\u275A", "One step of the run (.)", feed.keys["."]),
        button("live", "live", "Back to the present (End)", () => follow(true)),
        button("reset", "\u21BA", "The run begins anew", () => { follow(true); send({ do: "reset" }); }),
      );
      page.element("live").setAttribute("aria-pressed", "true");
    }

    // -------------------------------------------------------------- what the page asks of a feed
    function follow(on) {
      if (following === on) return;
      following = on;
      page.element("live").setAttribute("aria-pressed", String(on));
      if (on) {
        page.play_past(false);
        fresh = true;
        page.label_play(!state.held);
      }
    }

    let before = 0, slow = 0, fast = 0, soft = false;

    /** Without a graphics card, light is computed for each corner instead of each pixel, five times as fast. */
    function cheapen() {
      if (!soft) return;
      const { scene: all } = page.viewer;
      all.background = new (three().Color)(0xd3d9df);
      all.traverse((one) => {
        const old = one.isMesh && one.material;
        if (!old || !old.isMeshPhongMaterial) return;
        const { color, opacity, transparent, depthTest, depthWrite, vertexColors } = old;
        const side = depthTest ? old.side : three().FrontSide; // transparent meshes with two sides are drawn twice
        one.material = new (three().MeshLambertMaterial)({ color, side, opacity, transparent, depthTest, depthWrite, vertexColors });
      });
    }

    /** A skin with every second corner of every second ring: a quarter of the triangles. */
    function coarsen() {
      const { geometry } = page.layer("skin").getObjectByProperty("isMesh", true);
      const corners = scene.skin.around.length - 1, tail = geometry.attributes.position.count - 2, last = tail - corners, faces = [];
      for (let c = 0; c < corners; c += 2) {
        const next = (c + 2) % corners;
        faces.push(tail, next, c, tail + 1, last + c, last + next);
        for (let at = 0; at < last; at += 2 * corners) {
          const a = at + c, b = at + next, over = 2 * corners;
          faces.push(a, b, b + over, a, b + over, a + over);
        }
      }
      geometry.setIndex(faces);
    }

    /** Draw fewer pixels if pictures come too late. */
    function keep_pace(stamp) {
      const passed = stamp - before, { renderer } = page.viewer, ratio = renderer.getPixelRatio();
      before = stamp;
      [slow, fast] = [passed > 45 ? slow + 1 : 0, passed < 25 ? fast + 1 : 0];
      const next = slow >= 4 ? Math.max(0.8 * ratio, 0.4) : fast > 200 ? Math.min(1.2 * ratio, window.devicePixelRatio) : ratio;
      if (next !== ratio) {
        [slow, fast] = [0, 0];
        renderer.setPixelRatio(next);
        page.viewer.set_dirty();
      }
    }

    const feed = {
      data, pose, follow, send,
      arrays: [], messages: [],
      keys: { ".": () => { follow(true); send({ do: "step" }); } },
      at_head: () => following,
      hold: (on) => send({ do: on ? "hold" : "go" }),
      speed: (value) => send({ do: "speed", value }),
      /** Without a graphics card, smooth edges and shadows take most of the time. */
      renderer(pane) {
        const probe = document.createElement("canvas").getContext("webgl"), about = probe && probe.getExtension("WEBGL_debug_renderer_info");
        soft = about && /swiftshader|llvmpipe|software|basic render/i.test(probe.getParameter(about.UNMASKED_RENDERER_WEBGL));
        if (probe) probe.getExtension("WEBGL_lose_context").loseContext();
        const made = new (three().WebGLRenderer)({ antialias: !soft, alpha: true });
        made.shadowMap.enabled = !soft;
        made.shadowMap.type = three().PCFSoftShadowMap;
        pane.append(made.domElement);
        if (soft) requestAnimationFrame(() => made.setPixelRatio(0.7 * window.devicePixelRatio));
        return made;
      },
      attach(given) {
        page = given;
        make_trail();
        make_spring();
        make_buttons();
        if (soft) coarsen();
        if (scene.controls) make_controls(scene.controls);
        surround();
        tell();
      },
      tick(stamp) {
        keep_pace(stamp);
        if (!fresh) return false;
        fresh = !following;
        if (fresh) Object.assign(page.element("time"), { min: page.begin(), max: page.end() });
        return following;
      },
    };
    connect();
  });
})();
