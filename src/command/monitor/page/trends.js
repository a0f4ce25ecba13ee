// Trends of the last ten minutes, drawn by uPlot. They are paused while the user looks at a part of them.
"use strict";

const Trends = (() => {
  // Rows that are kept: ten minutes of ten values a second.
  const MOST = 6000;
  const SIGNALS = ["position", "reference", "error", "command"];
  // Colours that colour-blind readers can tell apart (Okabe and Ito), for a light and a dark background.
  const COLOURS = {
    light: ["#0072b2", "#d55e00", "#00795a", "#a8457f", "#8f6300", "#2384b8", "#505050", "#7d5a1e"],
    dark: ["#56b4e9", "#ff8c42", "#3fd0a0", "#e59ac5", "#f0c040", "#9ad4ff", "#c0c0c0", "#d0a060"],
  };
  const SHAPES = { error: ["error"], position: ["position", "reference"], command: ["command"] };
  // Time between two drawings, ms.
  const EVERY = 200;

  let names = [];
  let times = [];
  let rows = {};
  let plot = null;
  let drawn = 0;
  let isPaused = false;

  const by = (id) => document.getElementById(id);

  function begin(axes) {
    names = axes;
    times = [];
    rows = {};
    for (const name of names) rows[name] = Object.fromEntries(SIGNALS.map((signal) => [signal, []]));
    by("axis").replaceChildren(new Option("all", ""), ...names.map((name) => new Option(name, name)));
    pause(false);
    build();
  }

  // Takes over the history of the server, which ends where the frames begin.
  function fill(history) {
    if (!history.t || !names.every((name) => history[name])) return;
    const first = times.length ? times[0] : Infinity;
    const count = history.t.filter((t) => t / 1000 < first).length;
    times = history.t.slice(0, count).map((t) => t / 1000).concat(times);
    for (const name of names)
      for (const signal of SIGNALS) rows[name][signal] = history[name][signal].slice(0, count).concat(rows[name][signal]);
    trim();
    draw(true);
  }

  function trim() {
    const extra = times.length - MOST;
    if (extra <= 0) return;
    times.splice(0, extra);
    for (const name of names) for (const signal of SIGNALS) rows[name][signal].splice(0, extra);
  }

  function push(unixMs, axes) {
    const t = unixMs / 1000;
    if (axes.length !== names.length || (times.length && t <= times[times.length - 1])) return;
    times.push(t);
    for (const axis of axes) for (const signal of SIGNALS) rows[axis.name]?.[signal].push(axis[signal]);
    trim();
    draw(false);
  }

  function lines() {
    const shape = SHAPES[by("signal").value];
    const chosen = by("axis").value;
    const list = [];
    names.forEach((name, i) => {
      if (!chosen || chosen === name) shape.forEach((signal, j) => list.push({ name, signal, colour: i, isDashed: j > 0 }));
    });
    return list;
  }

  function data() {
    const factor = by("signal").value === "error" ? 1000 : 1;
    const scaled = (values) => (factor === 1 ? values : values.map((value) => (value === null ? null : factor * value)));
    return [times, ...lines().map(({ name, signal }) => scaled(rows[name][signal]))];
  }

  function build() {
    plot?.destroy();
    plot = null;
    if (!names.length) return;
    const style = getComputedStyle(document.documentElement);
    const [text, grid] = ["--text", "--line"].map((name) => style.getPropertyValue(name).trim());
    const colours = COLOURS[document.documentElement.dataset.theme === "dark" ? "dark" : "light"];
    const edge = { stroke: text, grid: { stroke: grid, width: 1 }, ticks: { stroke: grid } };
    const decimals = { error: 1, position: 3, command: 3 }[by("signal").value];
    const value = (_, value) => (value === null || value === undefined ? "-" : value.toFixed(decimals));
    const series = lines().map(({ name, signal, colour, isDashed }) => ({
      label: isDashed ? `${name} ${signal}` : name,
      stroke: colours[colour % colours.length],
      width: 1.75,
      dash: isDashed ? [6, 4] : undefined,
      points: { show: false },
      value,
    }));
    const box = by("plot");
    plot = new uPlot(
      {
        width: Math.max(200, box.clientWidth),
        height: 300,
        series: [{ value: (_, t) => (t ? new Date(1000 * t).toLocaleTimeString([], { hour12: false }) : "-") }, ...series],
        axes: [{ ...edge, space: 90, values: (_, ticks) => ticks.map((t) => clock(t)) }, { ...edge, size: 64 }],
        scales: { x: { time: true, range: () => range() } },
        cursor: { drag: { x: true, y: false, setScale: false } },
        hooks: { setSelect: [zoomed] },
      },
      data(),
      box,
    );
  }

  const clock = (t) => {
    const date = new Date(1000 * t);
    return [date.getHours(), date.getMinutes(), date.getSeconds()].map((part) => String(part).padStart(2, "0")).join(":");
  };

  // Shown times while paused; null for the newest ones.
  let shown = null;

  function range() {
    if (shown) return shown;
    const end = times.length ? times[times.length - 1] : Date.now() / 1000;
    return [end - Number(by("span").value), end];
  }

  function zoomed(plot) {
    const { left, width } = plot.select;
    if (width < 4) return;
    look([plot.posToVal(left, "x"), plot.posToVal(left + width, "x")]);
    plot.setSelect({ left: 0, top: 0, width: 0, height: 0 }, false);
  }

  // Shows these times and pauses.
  function look(span) {
    shown = span;
    pause(true);
    draw(true);
  }

  function zoom(factor) {
    const [begin, end] = range();
    const middle = (begin + end) / 2;
    const half = Math.max(0.25, (factor * (end - begin)) / 2);
    look([middle - half, middle + half]);
  }

  function pause(on) {
    if (on && !shown) shown = range();
    if (!on) shown = null;
    isPaused = on;
    by("pause").setAttribute("aria-pressed", String(on));
    by("pause").textContent = on ? "Paused" : "Pause";
    by("whole").hidden = !on;
    if (!on) draw(true);
  }

  function draw(isForced) {
    const now = performance.now();
    if (!plot || (!isForced && (isPaused || document.hidden || now - drawn < EVERY))) return;
    drawn = now;
    plot.setData(data());
  }

  for (const id of ["signal", "axis"]) by(id).addEventListener("change", build);
  by("span").addEventListener("change", () => pause(false));
  by("pause").addEventListener("click", () => pause(!isPaused));
  by("whole").addEventListener("click", () => pause(false));
  addEventListener("resize", () => plot?.setSize({ width: Math.max(200, by("plot").clientWidth), height: 300 }));
  addEventListener("keydown", (event) => {
    if (event.ctrlKey || event.altKey || event.metaKey || event.target.closest("select, input, textarea")) return;
    const act = { p: () => pause(!isPaused), "+": () => zoom(0.5), "-": () => zoom(2), 0: () => pause(false) }[event.key];
    if (act && plot) act();
  });

  return { begin, fill, push, build };
})();
