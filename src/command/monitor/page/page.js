// Connects to the server, and shows what it sends. Texts of the machine are set as text, never as HTML.
"use strict";

(() => {
  // A server that says nothing for so long is gone, ms. It speaks at least once a second.
  const SILENCE = 2500;
  // A state of the axes that is older than this is no longer the present one, ms. There are ten a second.
  const STALE = 700;
  const by = (id) => document.getElementById(id);

  let source = null;
  let heard = performance.now();
  let hello = null;
  // The newest frame, and when it came.
  let frame = null;
  let came = 0;
  let cards = new Map();
  let frames = 0;

  const node = (name, className, text) => {
    const node = document.createElement(name);
    if (className) node.className = className;
    if (text !== undefined) node.textContent = text;
    return node;
  };
  // Sets a text only where it changes: a changed text is laid out again.
  const set = (node, text) => {
    if (node.textContent !== text) node.textContent = text;
  };
  const fixed = (value, decimals) => (typeof value === "number" ? value.toFixed(decimals) : "-");
  const signed = (value, decimals) => (typeof value === "number" && value >= 0 ? "+" : "") + fixed(value, decimals);
  const time = (ns) => {
    if (typeof ns !== "number") return "-";
    if (ns < 1e6) return `${(ns / 1e3).toFixed(0)} µs`;
    if (ns < 1e9) return `${(ns / 1e6).toFixed(ns < 1e7 ? 1 : 0)} ms`;
    return `${(ns / 1e9).toFixed(1)} s`;
  };

  function connect() {
    source?.close();
    source = new EventSource("events");
    const on = (name, take) =>
      source.addEventListener(name, (event) => {
        heard = performance.now();
        take(JSON.parse(event.data));
      });
    on("hello", greet);
    on("events", events);
    on("stages", stages);
    on("axes", axes);
    // The server has nothing new to say, and is there.
    on("alive", () => {});
    source.onopen = () => (heard = performance.now());
  }

  function greet(said) {
    const facts = ({ attachment, group, machine, version }) => JSON.stringify([attachment, group, machine, version]);
    const isNew = !hello || facts(said) !== facts(hello);
    const isOther = hello && hello.version && said.version !== hello.version;
    hello = said;
    // A newer server has another page.
    if (isOther) return location.reload();
    set(by("version"), `Hydraxis ${said.version}. ${said.controls ? "" : "This page shows and operates nothing."}`);
    Control.begin(said.controls, said.axes, said.moves_teeth);
    if (!said.group) return look();
    set(by("machine-name"), said.machine ?? "Hydraxis");
    set(by("group"), `group ${said.group}`);
    document.title = `${said.machine ?? "Hydraxis"}: ${said.group}`;
    if (!isNew && cards.size) return;
    frame = null;
    Details.begin();
    Machine.begin(said.view);
    cards = new Map();
    by("cards").replaceChildren();
    look();
  }

  // Cards, trends and history of the axes of a frame.
  function begin(list) {
    cards = new Map(list.map((axis) => [axis.name, card(axis.name)]));
    by("cards").replaceChildren(...[...cards.values()].map((card) => card.root));
    Trends.begin(list.map((axis) => axis.name));
    fetch("history").then((answer) => answer.json()).then(Trends.fill).catch(() => {});
  }

  const NAMES = "http://www.w3.org/2000/svg";
  function bar(label, parts) {
    const svg = document.createElementNS(NAMES, "svg");
    svg.setAttribute("viewBox", "0 0 200 20");
    svg.setAttribute("preserveAspectRatio", "none");
    svg.setAttribute("role", "img");
    svg.setAttribute("aria-label", label);
    const rects = parts.map((name) => {
      const rect = document.createElementNS(NAMES, "rect");
      rect.setAttribute("class", name);
      rect.setAttribute("y", name === "bar" || name === "bar-fill" ? 5 : 1);
      rect.setAttribute("height", name === "bar" || name === "bar-fill" ? 10 : 18);
      svg.append(rect);
      return rect;
    });
    return { svg, rects };
  }
  function span(rect, from, to) {
    rect.setAttribute("x", (200 * Math.min(from, to)).toFixed(1));
    rect.setAttribute("width", Math.max(0, 200 * Math.abs(to - from)).toFixed(1));
  }
  const mark = (rect, at) => span(rect, at - 0.008, at + 0.008);

  function card(name) {
    const root = node("article", "card");
    const head = node("h3", "", name);
    const mode = node("span", "", "-");
    head.append(mode);
    const list = node("dl");
    const row = (label, className) => {
      const value = node("dd", className, "-");
      list.append(node("dt", "", label), value);
      return value;
    };
    const error = row("error", "big");
    const position = row("position");
    const reference = row("reference");
    const place = bar("Position within the stroke, with the reference", ["bar", "bar-limit", "bar-limit", "bar-fill", "bar-mark"]);
    const command = node("dd", "", "-");
    const push = bar("Valve command from -1 to 1", ["bar", "bar-fill", "bar-limit"]);
    const more = node("dl");
    more.append(node("dt", "", "command"), command);
    const model = node("dd", "", "-");
    const modelRow = [node("dt", "", "model"), model];
    const rest = node("dl");
    rest.append(...modelRow);
    const flags = node("ul", "flags");
    flags.setAttribute("aria-label", `Flags of ${name}`);
    const why = node("p", "why");
    const gain = node("p", "why");
    root.append(head, list, place.svg, more, push.svg, rest, flags, gain, why);
    return { root, mode, error, position, reference, place, command, push, model, flags, gain, why, shown: "" };
  }

  function look_of(axis) {
    if (axis.is_latched) return "bad";
    if (axis.command_by === "manual" || axis.command_by === "commission") return "hand";
    return axis.command_by;
  }

  function show(axis) {
    const card = cards.get(axis.name);
    if (!card) return;
    const facts = hello?.axes.find((facts) => facts.name === axis.name);
    const isFollowing = axis.command_by === "model" || axis.command_by === "fallback";
    if (card.root.dataset.look !== look_of(axis)) card.root.dataset.look = look_of(axis);
    set(card.mode, axis.is_latched ? "LATCHED" : `${axis.mode}, ${axis.command_by}`);
    set(card.error, isFollowing ? `${signed(1000 * axis.error, 1)} mm` : "-");
    set(card.position, axis.position === null ? "unknown" : `${fixed(axis.position, 4)} m`);
    set(card.reference, isFollowing ? `${fixed(axis.reference, 4)} m` : "-");
    set(card.command, signed(axis.command, 3));
    const [ground, low, high, fill, reference] = card.place.rects;
    span(ground, 0, 1);
    card.place.svg.style.display = facts ? "" : "none";
    if (facts) {
      mark(low, facts.soft_limits[0] / facts.stroke);
      mark(high, facts.soft_limits[1] / facts.stroke);
      span(fill, 0, Math.min(1, Math.max(0, (axis.position ?? 0) / facts.stroke)));
      mark(reference, axis.reference / facts.stroke);
      reference.style.display = isFollowing ? "" : "none";
    }
    const [all, part, zero] = card.push.rects;
    span(all, 0, 1);
    span(part, 0.5, 0.5 + 0.5 * axis.command);
    mark(zero, 0.5);
    const sigma = axis.h_step_sigma === null ? "" : `, predicts to ${fixed(1000 * axis.h_step_sigma, 2)} mm`;
    set(card.model, axis.model_age_ns === null ? "none yet" : `${time(axis.model_age_ns)} old${sigma}`);
    const flags = [
      ...axis.flags.map((flag) => [flag, axis.is_latched || flag === "reference" || flag === "soft-limit"]),
      ...axis.sample_faults.map((fault) => [`sample ${fault}`, fault !== "stuck"]),
      ...axis.model_faults.map((fault) => [`model ${fault}`, false]),
    ];
    const text = JSON.stringify(flags);
    if (card.shown !== text) {
      card.shown = text;
      card.flags.replaceChildren(...flags.map(([flag, isBad]) => node("li", isBad ? "bad" : "", flag)));
    }
    set(card.gain, axis.gain === 1 || axis.gain === 0 ? "" : `Gains of the fallback: ${fixed(axis.gain, 2)} times those of the machine file`);
    set(card.why, axis.why_fallback ? `By the fallback: ${axis.why_fallback}` : "");
  }

  function teeth(now) {
    if (!now) return "teeth: not known";
    const [x, z] = now.at.map((value) => fixed(value, 3));
    const place = `teeth at x ${x} m, z ${z} m, pitch ${fixed(now.pitch, 1)}°, ${fixed(now.payload, 0)} kg in the bucket`;
    if (now.error === null) return place;
    return `${place}; ${fixed(1e3 * now.error, 1)} mm from their way, pitch off by ${fixed(now.pitch_error, 2)}°`;
  }

  function axes(said) {
    if (!hello?.group) return;
    if (said.axes.length !== cards.size || said.axes.some((axis) => !cards.has(axis.name))) begin(said.axes);
    frame = said;
    came = performance.now();
    said.axes.forEach(show);
    Control.see(said.axes);
    Machine.draw(said.pose);
    set(by("teeth"), teeth(said.teeth));
    if (said.age_ns !== null && said.age_ns < 1e6 * STALE) Trends.push(said.unix_ms, said.axes);
    set(by("tick"), said.tick === null ? "-" : String(said.tick));
    const passed = said.tick !== null && hello.period_s ? `${(said.tick * hello.period_s).toFixed(1)} s` : "-";
    set(by("time"), passed);
    frames += 1;
    document.body.dataset.frames = String(frames);
    look();
  }

  // A table with these cells; a cell is a text, or a text and its class.
  function table(id, header, rows) {
    const cell = (name, content) => {
      const [text, className] = Array.isArray(content) ? content : [content, ""];
      return node(name, className, text);
    };
    const line = (cells, name) => {
      const row = node("tr");
      row.append(...cells.map((content) => cell(name, content)));
      return row;
    };
    const head = node("thead");
    const titles = line(header, "th");
    titles.childNodes.forEach((cell) => cell.setAttribute("scope", "col"));
    head.append(titles);
    const body = node("tbody");
    body.append(...rows.map((cells) => line(cells, "td")));
    by(id).replaceChildren(head, body);
  }

  const count = (value) => (value > 0 ? [String(value), "bad"] : "0");

  function stages(said) {
    if (!said.stages) return;
    const header = ["stage", "state", "heard", "ticks/s", "lost", "late: input", "release", "work", "work p50", "p99", "p99.99", "max"];
    table("stage-table", header, said.stages.map((stage) => {
      const isSilent = said.silent.includes(stage.name);
      return [
        stage.name,
        isSilent ? ["silent", "bad"] : [stage.state, stage.state === "running" ? "good" : ""],
        [time(stage.heartbeat_age_ns) + " ago", isSilent ? "bad" : ""],
        fixed(stage.rate_hz, 1),
        count(stage.lost),
        String(stage.missed_by_late_input),
        String(stage.missed_by_late_release),
        String(stage.missed_by_long_work),
        ...[stage.work_ns.p50, stage.work_ns.p99, stage.work_ns.p99_99, stage.work_ns.max].map(time),
      ];
    }));
    const kinds = [["wait_ns", "wait"], ["work_ns", "work"], ["end_to_end_ns", "end to end"], ["release_jitter_ns", "release jitter"]];
    const latencies = said.stages.flatMap((stage) =>
      kinds.filter(([kind]) => stage[kind].count > 0).map(([kind, name]) => {
        const { count, p50, p99, p99_9, p99_99, max } = stage[kind];
        return [`${stage.name} ${name}`, String(count), ...[p50, p99, p99_9, p99_99, max].map(time)];
      }));
    table("latency-table", ["latency", "count", "p50", "p99", "p99.9", "p99.99", "max"], latencies);
    const channels = said.stages.flatMap((stage) =>
      Object.entries(stage.channels).map(([channel, { received, lost, foreign, age_ns, longest_gap_ns }]) => [
        `${stage.name} reads ${channel}`, String(received), count(lost), count(foreign), time(age_ns), time(longest_gap_ns),
      ]));
    table("channel-table", ["channel", "read", "lost", "foreign", "age", "longest gap"], channels);
    by("warnings").replaceChildren(...said.warnings.map((warning) => node("li", "", warning)));
  }

  let all = [];
  function events(said) {
    all = Array.isArray(said) ? said : [];
    list();
  }
  function list() {
    const isFaultsOnly = by("faults-only").checked;
    const shown = all.filter((event) => event.is_fault || !isFaultsOnly).reverse();
    by("event-list").replaceChildren(...shown.map((event) => {
      const item = node("li", event.is_fault ? "fault" : "");
      const at = node("time", "", new Date(event.unix_ms).toLocaleTimeString([], { hour12: false }));
      at.dateTime = new Date(event.unix_ms).toISOString();
      const more = event.more > 0 ? ` (and ${event.more} more times before)` : "";
      item.append(at, node("b", "", event.axis ?? "group"), `${event.kind}: ${event.text}${more}`);
      if (event.next) item.append(node("span", "next", event.next));
      return item;
    }));
    by("no-events").hidden = shown.length > 0;
  }

  // Whether what is shown is the present; called with each frame and several times a second.
  function look() {
    const now = performance.now();
    const latched = frame ? frame.axes.filter((axis) => axis.is_latched).map((axis) => axis.name) : [];
    const age = frame && frame.age_ns !== null ? frame.age_ns / 1e6 + (now - came) : null;
    let state = "live";
    let text = "live";
    let alarm = "";
    if (now - heard > SILENCE) {
      [state, text] = ["lost", "no connection"];
      alarm = `No connection to the monitor for ${((now - heard) / 1000).toFixed(0)} s. What is shown is old. Trying again.`;
    } else if (hello && !hello.group) {
      [state, text] = ["absent", "no group"];
      alarm = `No group: ${hello.why}. What is shown is old. It comes back by itself.`;
    } else if (!hello || !frame) {
      [state, text] = ["waiting", "waiting for data"];
    } else if (age === null) {
      [state, text] = ["waiting", "no controller has sent anything yet"];
    } else if (age > STALE) {
      [state, text] = ["stale", `no data for ${(age / 1000).toFixed(1)} s`];
      alarm = `The controller has said nothing for ${(age / 1000).toFixed(0)} s. What is shown is old.`;
    } else if (latched.length) {
      alarm = `Latched by a fault: ${latched.join(", ")}. The valves are neutral. The list of faults says why.`;
    }
    if (document.body.dataset.state !== state) document.body.dataset.state = state;
    set(by("state-text"), text);
    set(by("age"), age === null ? "-" : `${age.toFixed(0)} ms`);
    set(by("alarm"), alarm);
    by("alarm").hidden = !alarm;
  }

  function theme(name) {
    document.documentElement.dataset.theme = name;
    set(by("theme"), name === "dark" ? "Light" : "Dark");
    by("theme").setAttribute("aria-label", name === "dark" ? "Light colours" : "Dark colours");
    Trends.build();
  }
  const wanted = matchMedia("(prefers-color-scheme: dark)");
  let kept = null;
  try {
    kept = localStorage.getItem("theme");
  } catch {
    // A browser without storage takes the colours of its system.
  }
  theme(kept ?? (wanted.matches ? "dark" : "light"));
  wanted.addEventListener("change", () => kept ?? theme(wanted.matches ? "dark" : "light"));
  by("theme").addEventListener("click", () => {
    kept = document.documentElement.dataset.theme === "dark" ? "light" : "dark";
    theme(kept);
    try {
      localStorage.setItem("theme", kept);
    } catch {
      // Then it holds until the page is loaded again.
    }
  });
  by("faults-only").addEventListener("change", list);
  setInterval(() => {
    // A browser gives up after some errors; a silent connection may be dead without one.
    if (source.readyState === EventSource.CLOSED || performance.now() - heard > 2 * SILENCE) {
      if (performance.now() - tried > 1000) {
        tried = performance.now();
        connect();
      }
    }
    look();
  }, 250);
  let tried = performance.now();
  connect();
})();
