"use strict";
// Tools of a page, live or from disc: plots beside the worm, a measure, a still and a film.
(function () {
  const WIDE = 236, HIGH = 64, COLOURS = ["#c2410c", "#0369a1", "#15803d", "#7e22ce", "#a16207", "#be185d", "#0f766e", "#44403c"];
  const PLOT_EVERY = 200; // [ms]

  window.worm3d_tools = (page) => {
    const { viewer, scene, data, element } = page, live = element("scene").dataset.form === "live";
    const plots = [], fine = Math.ceil(window.devicePixelRatio);
    let drawn = -PLOT_EVERY, ends = [], line = null, measuring = false, recorder = null;

    function button(name, label, title, does) {
      const made = document.createElement("button");
      Object.assign(made, { type: "button", value: name, textContent: label, title });
      made.addEventListener("click", () => does(made));
      element("tools").append(made);
      return made;
    }

    // -------------------------------------------------------------- plots
    function make_plots() {
      const known = (scene.plots || []).filter(({ name }) => data.has(name));
      for (const about of known) {
        const figure = document.createElement("figure"), title = document.createElement("figcaption"), canvas = document.createElement("canvas");
        Object.assign(canvas, { width: fine * WIDE, height: fine * HIGH, title: "click: go to this time" });
        canvas.dataset.plot = about.name;
        canvas.addEventListener("pointerdown", (event) => jump(event, canvas));
        canvas.addEventListener("pointermove", (event) => { if (event.buttons === 1) jump(event, canvas); });
        figure.append(title, canvas);
        element("plots").append(figure);
        plots.push({ about, title, canvas });
      }
      if (plots.length === 0) return;
      const toggle = button("plots", "plots", "speed, strains, loads and energy beside the worm", () => open(element("plots").hidden));
      function open(on) {
        element("plots").hidden = !on;
        toggle.setAttribute("aria-pressed", String(on));
        page.centre_view();
        draw();
      }
      if (live && window.innerWidth > 900) open(true);
    }

    function jump(event, canvas) {
      const box = canvas.getBoundingClientRect(), share = Math.min(Math.max((event.clientX - box.left) / box.width, 0), 1);
      page.go_to(page.begin() + share * (page.end() - page.begin()));
    }

    function draw() {
      if (element("plots").hidden) return;
      for (const { about, title, canvas } of plots) {
        // Without a graphics card, drawing in memory is much faster.
        const pen = canvas.getContext("2d", { willReadFrequently: true }), wide = canvas.width, high = canvas.height;
        const from = page.begin(), span = Math.max(page.end() - from, 1e-9), count = data.get(about.name, 0).length;
        const stride = Math.max(1, Math.floor(data.length / WIDE)), points = [];
        let low = 0, top = 0;
        for (let k = 0; k < data.length; k += stride) {
          const values = Array.from(data.get(about.name, k), (value) => about.factor * value);
          low = Math.min(low, ...values);
          top = Math.max(top, ...values);
          points.push([(data.time(k) - from) / span, values]);
        }
        const y = (value) => high - 3 * fine - ((value - low) / Math.max(top - low, 1e-9)) * (high - 6 * fine);
        pen.clearRect(0, 0, wide, high);
        pen.lineWidth = fine / 2;
        pen.strokeStyle = "#9aa1ab";
        stroke(pen, [[0, y(0)], [wide, y(0)]]);
        pen.lineWidth = fine;
        for (let c = 0; c < count; c++) {
          pen.strokeStyle = COLOURS[c % COLOURS.length];
          stroke(pen, points.map(([x, values]) => [x * wide, y(values[c])]));
        }
        pen.strokeStyle = "#23262b";
        const now = ((page.now() - from) / span) * wide;
        stroke(pen, [[now, 0], [now, high]]);
        title.textContent = `${about.title}, ${Number(low.toPrecision(2))} to ${Number(top.toPrecision(2))} ${about.unit}`;
      }
    }

    function stroke(pen, points) {
      pen.beginPath();
      for (const [x, y] of points) pen.lineTo(x, y);
      pen.stroke();
    }

    // -------------------------------------------------------------- measure
    function make_measure() {
      const pane = element("meshcat-pane");
      let pressed = null;
      const toggle = button("measure", "measure", "click on two places: their distance", () => {
        measuring = !measuring;
        toggle.setAttribute("aria-pressed", String(measuring));
        ends = [];
        show_measure();
      });
      pane.addEventListener("pointerdown", (event) => { pressed = [event.clientX, event.clientY]; });
      pane.addEventListener("pointerup", (event) => {
        if (!measuring || !pressed || Math.hypot(event.clientX - pressed[0], event.clientY - pressed[1]) > 4) return;
        const hit = page.hit(event.clientX, event.clientY, ["skin", "chambers", "links", "faces", "world"]);
        if (!hit) return;
        ends = ends.length === 1 ? [ends[0], hit.point] : [hit.point];
        show_measure();
      });
    }

    function show_measure() {
      const { THREE } = MeshCat, tag = element("tag");
      if (!line) {
        line = new THREE.Line(new THREE.BufferGeometry(), new THREE.LineBasicMaterial({ color: 0x1d4ed8, depthTest: false, transparent: true }));
        line.frustumCulled = false;
        line.renderOrder = 3;
        viewer.scene.add(line);
      }
      line.visible = ends.length === 2;
      if (line.visible) line.geometry.setFromPoints(ends.map((place) => viewer.scene.worldToLocal(place.clone())));
      tag.hidden = !line.visible;
      if (line.visible) {
        tag.textContent = `${Number((1000 * ends[0].distanceTo(ends[1])).toPrecision(4))} mm`;
        place_tag(ends[1]);
      }
      viewer.set_dirty();
    }

    /** Put the tag beside a place of the scene, in the coordinates of three.js. */
    function place_tag(place) {
      const seen = place.clone().project(viewer.camera), pane = element("meshcat-pane");
      const x = (0.5 + 0.5 * seen.x) * pane.clientWidth, y = (0.5 - 0.5 * seen.y) * pane.clientHeight, tag = element("tag");
      tag.style.left = `${Math.min(Math.max(x + 10, 0), pane.clientWidth - 70)}px`;
      tag.style.top = `${Math.min(Math.max(y - 10, 0), pane.clientHeight - 30)}px`;
    }

    // -------------------------------------------------------------- still and film
    function offer(blob, name) {
      const link = document.createElement("a");
      Object.assign(link, { href: URL.createObjectURL(blob), download: name });
      link.click();
      setTimeout(() => URL.revokeObjectURL(link.href), 10000);
      document.documentElement.dataset.offered = `${name} ${blob.type} ${blob.size}`;
    }

    function still() {
      viewer.renderer.render(viewer.scene, viewer.camera);
      viewer.renderer.domElement.toBlob((blob) => offer(blob, `still-${page.now().toFixed(2)}s.png`));
    }

    /** Record what is seen until the button is pressed again, or a finished run has come to its end. */
    function film(toggle) {
      if (recorder) { recorder.stop(); return; }
      const parts = [];
      recorder = new MediaRecorder(viewer.renderer.domElement.captureStream(30));
      recorder.ondataavailable = (event) => parts.push(event.data);
      recorder.onstop = () => {
        offer(new Blob(parts, { type: recorder.mimeType }), "film.webm");
        recorder = null;
        toggle.setAttribute("aria-pressed", "false");
      };
      toggle.setAttribute("aria-pressed", "true");
      if (!live) {
        element("loop").checked = false; // a film ends with the run
        page.show(page.begin());
        page.play(true);
      }
      recorder.start(500);
    }

    make_plots();
    make_measure();
    button("still", "still", "a picture of the scene as it is seen", still);
    if (typeof MediaRecorder !== "undefined") button("film", "film", "a film of the scene: click to begin and to end", film);
    if (page.guest) element("tools").remove();
    Object.assign(page, { place_tag });

    return {
      /** Called after each change of the instant. */
      seen() {
        if (ends.length === 2) place_tag(ends[1]);
        if (recorder && !live && page.now() >= page.end()) recorder.stop();
        if (performance.now() - drawn < PLOT_EVERY && (live || page.playing())) return;
        drawn = performance.now();
        draw();
      },
    };
  };
})();
