"use strict";
// One set of controls for the pages in this one. Each is told its state by messages, in the words of its address.
(function () {
  const element = (id) => document.getElementById(id);
  const runs = JSON.parse(element("runs").textContent);
  const pages = [...document.querySelectorAll("iframe")];
  const begin = Math.min(...runs.map((run) => run.begin)), end = Math.max(...runs.map((run) => run.end));
  const step = 0.1, cameras = { side: "side", top: "top", follow: "follow", inside: "front" };
  let now = begin, playing = false, rate = 1, last = null, camera = "follow", ready = 0;

  const tell = (k, state) => pages[k].contentWindow.postMessage(state, "*");
  const tell_all = (state) => pages.forEach((_, k) => tell(k, state));

  function show(instant) {
    now = Math.min(Math.max(instant, begin), end);
    runs.forEach((run, k) => tell(k, `t=${now - run.begin}`));
    element("time").value = now;
    element("now").textContent = `${now.toFixed(2)} / ${end.toFixed(2)} s`;
    document.documentElement.dataset.time = now.toFixed(3);
  }

  function play(on) {
    if (on && now >= end) show(begin);
    playing = on && end > begin;
    last = null;
    element("play").textContent = playing ? "\u275A\u275A" : "\u25B6";
    element("play").setAttribute("aria-label", playing ? "Pause" : "Play");
  }

  function tick(stamp) {
    requestAnimationFrame(tick);
    if (!playing) return;
    const passed = last === null ? 0 : Math.min((stamp - last) / 1000, 0.25);
    last = stamp;
    const target = now + rate * passed;
    if (target < end) show(target);
    else if (element("loop").checked) show(begin + (target - end));
    else { show(end); play(false); }
  }

  function choose(name) {
    camera = name;
    tell_all(`camera=${name}`);
    for (const button of element("cameras").children) button.setAttribute("aria-pressed", String(button.value === name));
  }

  const keys = {
    " ": () => play(!playing),
    ArrowRight: () => show(now + step),
    ArrowLeft: () => show(now - step),
    Home: () => show(begin),
    End: () => show(end),
  };

  window.addEventListener("keydown", (event) => {
    if (!keys[event.key] || event.ctrlKey || event.altKey || event.metaKey) return;
    if (event.target.matches("select, button, input[type=checkbox]") && event.key === " ") return;
    if (event.target.matches("select")) return;
    event.preventDefault();
    keys[event.key]();
  });

  /** `compare.html#t=2.5&camera=top&play=1` */
  function obey(hash) {
    const asked = new URLSearchParams(hash.replace(/^#/, ""));
    if (asked.has("t")) show(Number(asked.get("t")) || 0);
    if (cameras[asked.get("camera")]) choose(asked.get("camera"));
    if (asked.has("play")) play(asked.get("play") !== "0");
  }

  function start() {
    choose(camera);
    show(now);
    obey(location.hash);
    document.documentElement.dataset.state = "ready";
  }

  // What the pages say: that they are ready, or which key was pressed in them.
  window.addEventListener("message", (event) => {
    if (!pages.some((page) => page.contentWindow === event.source)) return;
    if (event.data === "ready") { if (++ready === pages.length) start(); }
    else if (keys[event.data]) keys[event.data]();
  });

  for (const [name, label] of Object.entries(cameras)) {
    const button = document.createElement("button");
    Object.assign(button, { type: "button", value: name, textContent: label });
    button.addEventListener("click", () => choose(name));
    element("cameras").append(button);
  }
  Object.assign(element("time"), { min: begin, max: end > begin ? end : begin + 1, value: begin });
  element("time").addEventListener("input", (event) => { play(false); show(Number(event.target.value)); });
  element("play").addEventListener("click", () => play(!playing));
  element("rate").addEventListener("change", (event) => { rate = Number(event.target.value); });
  window.addEventListener("hashchange", () => obey(location.hash));
  play(false);
  requestAnimationFrame(tick);
})();
