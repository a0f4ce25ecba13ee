// Models, latencies and the way of the last tick. They are asked for only while their sections are open.
"use strict";

const Details = (() => {
  // Time between two questions, ms; and rows that are kept: five minutes.
  const EVERY = 500;
  const MOST = 600;
  // Earlier curves of the valve that are kept, and time between two of them, ms.
  const GHOSTS = 6;
  const GHOST_EVERY = 10000;
  const NAMES = "http://www.w3.org/2000/svg";
  const by = (id) => document.getElementById(id);

  let axes = new Map();
  let newest = null;
  let plots = [];
  let shape = "";

  const style = (name) => getComputedStyle(document.documentElement).getPropertyValue(name).trim();
  const mm = (value) => (typeof value === "number" ? `${(1000 * value).toPrecision(3)} mm` : "-");

  function ask() {
    const isOpen = by("models").open || by("ticks").open;
    if (!isOpen || document.hidden) return;
    fetch("details").then((answer) => answer.json()).then(take).catch(() => {});
  }

  // The rms of the errors between two states of running statistics, mm.
  function between(before, now) {
    const count = now.count - before.count;
    if (!(count > 0)) return null;
    const squares = (errors) => errors.count * errors.rmse ** 2;
    return 1000 * Math.sqrt(Math.max(0, squares(now) - squares(before)) / count);
  }

  function keep(axis) {
    let kept = axes.get(axis.name);
    if (!kept) axes.set(axis.name, (kept = { rows: [], ghosts: [], ghosted: -Infinity, before: null }));
    const now = performance.now();
    const errors = axis.models.map((model) => model.h_step);
    if (kept.before && errors[0].count < kept.before[0].count) Object.assign(kept, { rows: [], before: null });
    // A span has at least 50 errors, so that the line is not only noise.
    if (!kept.before) kept.before = errors;
    let span = [null, null];
    if (errors[0].count - kept.before[0].count >= 50) {
      span = errors.map((errors, i) => between(kept.before[i], errors));
      kept.before = errors;
    }
    const { a, b, f, g } = axis.models[1].coefficients;
    kept.rows.push({ t: Date.now() / 1000, span, a, b, f, g });
    if (kept.rows.length > MOST) kept.rows.shift();
    if (now - kept.ghosted > GHOST_EVERY) {
      kept.ghosted = now;
      kept.ghosts.push(axis.models[1].curve);
      if (kept.ghosts.length > GHOSTS) kept.ghosts.shift();
    }
  }

  function take(said) {
    if (!said.axes) return;
    newest = said;
    said.axes.forEach(keep);
    const names = said.axes.map((axis) => axis.name);
    const select = by("model-axis");
    if (names.join() !== [...select.options].map((option) => option.value).join()) {
      select.replaceChildren(...names.map((name) => new Option(name, name)));
      shape = "";
    }
    by("no-models").hidden = names.length > 0;
    by("model-body").hidden = !names.length;
    if (by("models").open) models();
    if (by("ticks").open) ticks(said);
  }

  function chart(id, label, x, series) {
    const edge = { stroke: style("--text"), grid: { stroke: style("--line"), width: 1 }, ticks: { stroke: style("--line") } };
    const box = by(id);
    const value = (_, value) => (value === null || value === undefined ? "-" : value.toPrecision(4));
    const plot = new uPlot({
      width: Math.max(220, box.clientWidth), height: 240, cursor: { drag: { x: false, y: false } },
      scales: { x: { time: x.isTime } },
      axes: [{ ...edge, space: 70, label: x.label, labelSize: 20, ...(x.isTime && { values: (_, ticks) => ticks.map(clock) }) }, { ...edge, size: 66, label, labelSize: 20 }],
      series: [{ label: x.name, value: x.isTime ? () => "" : value }, ...series.map((line) => ({ points: { show: false }, spanGaps: true, value, ...line }))],
    }, [[]].concat(series.map(() => [])), box);
    return plot;
  }

  const clock = (t) => new Date(1000 * t).toLocaleTimeString([], { hour12: false });

  function models() {
    const axis = newest.axes.find((axis) => axis.name === by("model-axis").value);
    if (!axis) return;
    const kept = axes.get(axis.name);
    const [held, adaptive] = axis.models;
    const group = by("model-group").value;
    const count = adaptive.coefficients[group].length;
    const wanted = [axis.name, group, count, kept.ghosts.length, document.documentElement.dataset.theme].join();
    if (wanted !== shape) {
      shape = wanted;
      plots.forEach((plot) => plot.destroy());
      const [blue, orange] = [style("--accent"), style("--ref")];
      const time = { isTime: true, name: "time" };
      const colours = [blue, orange, style("--good"), style("--quiet"), style("--bad"), style("--warn")];
      plots = [
        chart("plot-errors", "prediction error rms, mm", time, [
          { label: "held", stroke: orange, width: 2 }, { label: "adaptive", stroke: blue, width: 2 }]),
        chart("plot-valve", "travel, mm", { isTime: false, name: "command u", label: "command u" }, [
          ...kept.ghosts.map((_, i) => ({ label: `${(kept.ghosts.length - i) * 10} s ago`, stroke: style("--line"), width: 1.5 })),
          { label: "held", stroke: orange, width: 2 }, { label: "adaptive", stroke: blue, width: 2.5 }]),
        chart("plot-coefficients", `coefficients ${group}`, time, Array.from({ length: count }, (_, i) => ({
          label: `${group}${i + (group === "b" ? 0 : 1)}`, stroke: colours[i % colours.length], width: 1.75 }))),
      ];
    }
    const times = kept.rows.map((row) => row.t);
    plots[0].setData([times, ...[0, 1].map((i) => kept.rows.map((row) => row.span[i]))]);
    const x = adaptive.curve.map(([u]) => u);
    // An earlier curve may be over other commands: it is shown where both are.
    const on = (curve) => x.map((u) => {
      const i = curve.findIndex(([at]) => at >= u);
      if (i < 0 || (i === 0 && curve[0][0] > u)) return null;
      const [[u0, y0], [u1, y1]] = [curve[Math.max(0, i - 1)], curve[i]];
      return 1000 * (u1 === u0 ? y1 : y0 + ((y1 - y0) * (u - u0)) / (u1 - u0));
    });
    plots[1].setData([x, ...kept.ghosts.map(on), on(held.curve), on(adaptive.curve)]);
    plots[2].setData([times, ...Array.from({ length: count }, (_, i) => kept.rows.map((row) => row[group][i] ?? null))]);
    const band = ({ dead_band: [low, high] }) => `-${low.toFixed(3)} to +${high.toFixed(3)}`;
    const reduction = 100 * (1 - adaptive.h_step.sigma / held.h_step.sigma);
    const list = ({ coefficients }, name) => coefficients[name].map((value) => value.toPrecision(3)).join("  ");
    weights(axis.weights);
    rows("model-table", ["figure", "held model", "adaptive model"], [
      [`prediction error, ${axis.horizon} samples ahead`, mm(held.h_step.sigma), `${mm(adaptive.h_step.sigma)} (${Math.abs(reduction).toFixed(1)} % ${reduction < 0 ? "more" : "less"})`],
      ["one sample ahead", mm(held.one_step.sigma), mm(adaptive.one_step.sigma)],
      ["dead band of N(u)", band(held), band(adaptive)],
      ...["a", "b", "f", "g"].map((name) => [`coefficients ${name}`, list(held, name), list(adaptive, name)]),
      ["forgetting factor, updates", "-", `${axis.forgetting_factor.toFixed(5)}, ${axis.updates}`],
      ["faults", "-", axis.faults.join(", ") || "none"],
    ]);
  }

  // A bar for each estimator. The bars stay, so that a reader can select them.
  let bars = [];
  function weights(list) {
    by("bank").hidden = !list.length;
    if (bars.map((bar) => bar.name).join() !== list.map(([name]) => name).join()) {
      rows("weight-table", ["what it learns, memory in horizons", "of 100 %", "weight"], list.map(([name]) => [name, "", ""]));
      bars = [...by("weight-table").querySelectorAll("tbody tr")].map((row, i) => {
        const svg = document.createElementNS(NAMES, "svg");
        svg.setAttribute("viewBox", "0 0 100 10");
        svg.setAttribute("preserveAspectRatio", "none");
        svg.setAttribute("aria-hidden", "true");
        draw(svg, "rect", { width: 100, height: 10, class: "bar" });
        draw(svg, "rect", { width: 0, height: 10, class: "bar-fill" });
        row.children[1].append(svg);
        return { name: list[i][0], fill: svg.lastChild, text: row.children[2] };
      });
    }
    list.forEach(([, weight], i) => {
      bars[i].fill.setAttribute("width", (100 * weight).toFixed(1));
      bars[i].text.textContent = `${(100 * weight).toFixed(1)} %`;
    });
  }

  function rows(id, header, list) {
    const cell = (name, text) => Object.assign(document.createElement(name), { textContent: text });
    const row = (name, cells) => {
      const row = document.createElement("tr");
      row.append(...cells.map((text) => cell(name, text)));
      return row;
    };
    const head = document.createElement("thead");
    head.append(row("th", header));
    const body = document.createElement("tbody");
    body.append(...list.map((cells) => row("td", cells)));
    by(id).replaceChildren(head, body);
  }

  function draw(svg, name, attributes, text) {
    const node = document.createElementNS(NAMES, name);
    for (const [key, value] of Object.entries(attributes)) node.setAttribute(key, value);
    if (text !== undefined) node.textContent = text;
    svg.append(node);
  }
  const time = (ns) => (ns < 1e6 ? `${(ns / 1e3).toPrecision(3)} µs` : ns < 1e9 ? `${(ns / 1e6).toPrecision(3)} ms` : `${(ns / 1e9).toPrecision(3)} s`);

  function ticks(said) {
    const svg = by("hops");
    svg.replaceChildren();
    const { hops, histogram } = said;
    if (hops) {
      const steps = [["sensor-proc: sample", 0, hops.sample], ["ident-proc: models", hops.sample, hops.snapshot],
        ["control-proc: command", hops.sample, hops.command]].filter(([, , end]) => end !== null);
      const longest = Math.max(...steps.map(([, , end]) => end), 1);
      steps.forEach(([name, from, to], i) => {
        const x = (t) => 230 + (430 * t) / longest;
        draw(svg, "text", { x: 0, y: 22 + 30 * i, class: "label" }, name);
        draw(svg, "rect", { x: x(from), y: 8 + 30 * i, width: Math.max(2, x(to) - x(from)), height: 18, class: `hop hop-${i}` });
        draw(svg, "text", { x: 670, y: 22 + 30 * i, class: "label" }, time(to));
      });
      by("hops-text").textContent = `Tick ${hops.tick}: times since the acquisition of its sample. The command was sent after ${time(hops.command)}.`;
    }
    const chart = by("histogram");
    chart.replaceChildren();
    const all = histogram.reduce((sum, [, count]) => sum + count, 0);
    // Logarithmic: a single late tick among many is seen.
    const height = (count) => (count ? (110 * (1 + Math.log10(count))) / (1 + Math.log10(Math.max(10, all))) : 0);
    histogram.forEach(([, count], i) => {
      draw(chart, "rect", { x: 60 + 14 * i, y: 130 - height(count), width: 12, height: height(count), class: "hop hop-2" });
    });
    for (let i = 0; i <= 6; i++) {
      draw(chart, "text", { x: 60 + 112 * i, y: 150, class: "label middle" }, ["1 µs", "10 µs", "100 µs", "1 ms", "10 ms", "100 ms", "1 s"][i]);
    }
    draw(chart, "path", { d: "M60 130H740", class: "edge" });
    by("histogram-text").textContent = `${all} commands since this section was opened: time from the acquisition of a sample to sending its command. Heights are logarithmic.`;
  }

  for (const id of ["model-axis", "model-group"]) by(id).addEventListener("change", () => newest && models());
  for (const id of ["models", "ticks"]) by(id).addEventListener("toggle", ask);
  addEventListener("resize", () => (shape = ""));
  setInterval(ask, EVERY);

  return { begin: () => ((axes = new Map()), (shape = ""), (newest = null)) };
})();
