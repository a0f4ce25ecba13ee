// Operates axes, where the server allows it. An axis is armed only while a button is held down: this page sends a beat
// every 50 ms, each with the newest time that the server has told, and the server stops the axes when beats are missing.
"use strict";

const Control = (() => {
  // Time between two beats, ms.
  const BEAT = 50;
  // Time between two greetings while nothing is held, ms. They keep the connection, and show whether the token is right.
  const GREET = 1000;
  const by = (id) => document.getElementById(id);

  let token = null;
  let facts = [];
  let stamp = null;
  // The button that is held: its number, and what it asks for.
  let held = null;
  // What is said of an OFF that was not answered. It stands until one is.
  let alarm = "";
  let isBusy = false;
  // Set points that were used before the present one.
  let before = [];
  let target = null;

  // The token comes behind the address, and is removed from there, so that it is not in the history of the browser.
  function take() {
    try {
      if (location.hash.length > 20) {
        sessionStorage.setItem("token", location.hash.slice(1));
        history.replaceState(null, "", location.pathname);
      }
      token = sessionStorage.getItem("token");
    } catch {
      token = location.hash.length > 20 ? location.hash.slice(1) : null;
    }
  }

  function say(text, isBad) {
    if (alarm) [text, isBad] = [alarm, true];
    if (by("control-state").textContent !== text) by("control-state").textContent = text;
    by("control-state").classList.toggle("bad", Boolean(isBad));
  }

  async function post(path, body, keepalive) {
    const headers = { "content-type": "application/json" };
    if (token) headers["x-hydraxis-token"] = token;
    const answer = await fetch(`control/${path}`, { method: "POST", headers, body: JSON.stringify(body), keepalive });
    const text = await answer.text();
    let said = {};
    try {
      said = JSON.parse(text);
    } catch {
      // A refusal by the server or a proxy before the request was looked at.
    }
    if (!answer.ok) throw new Error(said.why ?? `status ${answer.status} ${text.trim().slice(0, 300)}`);
    if (typeof said.stamp === "number") stamp = said.stamp;
    return said;
  }

  async function off() {
    const button = by("off");
    letGo();
    button.dataset.state = "asked";
    try {
      await post("off", {}, true);
      button.dataset.state = "done";
      alarm = "";
      say("All axes are off.");
    } catch (error) {
      button.dataset.state = "failed";
      alarm = `OFF WAS NOT ANSWERED: ${error.message}. Cut the pressure off by hand if anything moves.`;
      say(alarm, true);
    }
    setTimeout(() => alarm || delete button.dataset.state, 3000);
  }

  const mode = () => by("control-mode").value;
  const movesTeeth = () => mode() === "teeth";
  // The first four axes move the teeth.
  const moving = () => facts.slice(0, 4).map((axis) => axis.name);
  const checked = () => [...by("control-axes").querySelectorAll("input:checked")].map((box) => box.value);
  const chosen = () => (movesTeeth() ? moving() : checked());
  const wanted = () => ({
    target: mode() === "hold" ? target : null,
    command: mode() === "manual" ? Number(by("command").value) / 100 : null,
  });
  // Where the teeth are to go; none where a field is empty.
  function place() {
    const [x, z, pitch, speed] = ["x", "z", "pitch", "speed"].map((name) => by(`teeth-${name}`).value.trim());
    if (!x || !z || !speed) return null;
    return { x: Number(x), z: Number(z), pitch: pitch ? Number(pitch) : null, speed: Number(speed) };
  }

  async function press() {
    if (held || !token) return;
    const axes = chosen();
    if (!axes.length) return say("Choose an axis first.", true);
    const teeth = movesTeeth() ? place() : null;
    if (movesTeeth() && !teeth) return say("Say how far forward, how high, and how fast.", true);
    const own = { hold: crypto.getRandomValues(new Uint32Array(1))[0], isOver: false };
    held = own;
    show();
    try {
      await post("hello", {});
      if (own.isOver) return;
      await post("press", { hold: own.hold, stamp, axes, mode: teeth ? "track" : mode(), teeth, ...wanted() });
      say(`Arming ${axes.join(", ")}.`);
      if (own.isOver) return void post("release", { hold: own.hold }, true).catch(() => {});
      own.timer = setInterval(() => beat(own), BEAT);
    } catch (error) {
      over(own, error.message);
    }
  }

  async function beat(own) {
    if (isBusy || own.isOver) return;
    isBusy = true;
    try {
      const said = await post("beat", { hold: own.hold, stamp, ...wanted() });
      if (own.isOver) return;
      if (said.phase === "ended") over(own, said.why || "the axes are off: by OFF, or because the beats of this page came too late");
      else if (said.phase !== "held") say("Arming.");
      else say(`${said.told || `${chosen().join(", ")}: ${mode()}`}, while you hold the button.`);
    } catch (error) {
      over(own, error.message);
    } finally {
      isBusy = false;
    }
  }

  function over(own, why) {
    own.isOver = true;
    clearInterval(own.timer);
    if (held === own) held = null;
    show();
    if (why) say(`Off: ${why}`, true);
  }

  // Ends what is held. The server ends it as well when it hears nothing.
  function letGo() {
    const own = held;
    if (!own) return;
    over(own);
    say("Released: the axes are off.");
    post("release", { hold: own.hold }, true).catch(() => {});
  }

  async function reset() {
    try {
      const said = await post("reset", { axes: chosen() });
      say(said.released.length ? `Released, was latched by: ${said.released.join("; ")}` : "No chosen axis is latched.");
    } catch (error) {
      say(`Not reset: ${error.message}`, true);
    }
  }

  // Gains that were used before the present ones, by axis; and what the axes have told last.
  const gainsBefore = new Map();
  let now = [];
  const tuned = () => now.find((axis) => axis.name === by("gain-axis").value);

  async function setGain(gain, isUndo) {
    const axis = tuned();
    if (!axis) return say("No axis yet.", true);
    const [least, largest] = axis.gain_range;
    if (!(gain >= least && gain <= largest)) {
      return say(`Gains: found ${by("gain").value || "nothing"}; allowed: ${least.toFixed(2)} to ${largest.toFixed(2)}`, true);
    }
    try {
      const said = await post("gain", { axis: axis.name, gain });
      const before = gainsBefore.get(axis.name) ?? [];
      if (isUndo) before.pop();
      else if (said.before !== gain) before.push(said.before);
      gainsBefore.set(axis.name, before);
      by("gain").value = "";
      say(`${axis.name}: gains ${gain.toFixed(2)} times those of the machine file; before ${said.before.toFixed(2)}.`);
    } catch (error) {
      say(`Gains not changed: ${error.message}`, true);
    }
    showGain();
  }

  function showGain() {
    const axis = tuned();
    const isOff = axis && axis.mode === "off";
    const [least, largest] = axis?.gain_range ?? [1, 1];
    const range = least === largest ? "none, without a commissioned model" : `${least.toFixed(2)} to ${largest.toFixed(2)}`;
    const text = [axis ? `${axis.gain.toFixed(2)} times` : "-", !axis ? "-" : isOff ? range : `${range}, when the axis is off`];
    if (by("gain-now").textContent !== text[0]) by("gain-now").textContent = text[0];
    if (by("gain-range").textContent !== text[1]) by("gain-range").textContent = text[1];
    by("gain-set").disabled = !token || !isOff || Boolean(held) || least === largest;
    by("gain-undo").disabled = !token || !isOff || Boolean(held) || !gainsBefore.get(axis.name)?.length;
  }

  // The newest state of the axes.
  function see(axes) {
    now = axes;
    if (!by("control").hidden) showGain();
  }

  // The range in which all chosen axes can hold.
  function range() {
    const axes = facts.filter((axis) => chosen().includes(axis.name));
    if (!axes.length) return null;
    return [Math.max(...axes.map((a) => a.soft_limits[0])), Math.min(...axes.map((a) => a.soft_limits[1]))];
  }

  function setTarget(value) {
    target = value;
    by("target").value = value === null ? "" : (1000 * value).toFixed(0);
    by("undo").disabled = !before.length;
    by("target-now").textContent = value === null ? "where the axis stops" : `${(1000 * value).toFixed(0)} mm`;
  }

  function apply() {
    const text = by("target").value.trim();
    const value = text === "" ? null : Number(text) / 1000;
    const allowed = range();
    if (value !== null && !(allowed && value >= allowed[0] && value <= allowed[1])) {
      const span = allowed ? allowed.map((edge) => (1000 * edge).toFixed(0)).join(" to ") + " mm" : "choose an axis first";
      return say(`Set point: found ${text}; allowed: ${span}`, true);
    }
    if (value === target) return;
    before.push(target);
    setTarget(value);
    say("Set point changed. Undo takes the one before.");
  }

  function show() {
    by("arm").setAttribute("aria-pressed", String(Boolean(held)));
    by("arm").textContent = held ? "HELD - let go to stop" : "Hold down to move";
    by("arm").disabled = !token;
    document.body.toggleAttribute("data-held", Boolean(held));
    for (const input of document.querySelectorAll("#control-axes input, #row-teeth input")) input.disabled = Boolean(held);
    by("control-mode").disabled = Boolean(held);
    by("row-target").hidden = mode() !== "hold";
    by("row-command").hidden = mode() !== "manual";
    by("row-teeth").hidden = !movesTeeth();
    by("control-axes").hidden = movesTeeth();
    by("all-axes").hidden = !movesTeeth();
    by("all-axes").textContent = moving().join(", ");
    by("command-now").textContent = `${by("command").value} %`;
    const allowed = range();
    by("target-range").textContent = allowed ? `${allowed.map((edge) => (1000 * edge).toFixed(0)).join(" to ")} mm` : "choose an axis first";
  }

  // Another machine, or none.
  function begin(controls, axes, teeth) {
    document.body.toggleAttribute("data-controls", controls);
    by("control").hidden = by("off").hidden = !controls;
    by("mode-teeth").hidden = by("mode-teeth").disabled = !teeth;
    if (!teeth && movesTeeth()) by("control-mode").value = "hold";
    if (!controls || JSON.stringify(axes) === JSON.stringify(facts)) return;
    facts = axes;
    by("control-axes").replaceChildren(...axes.map((axis) => {
      const label = document.createElement("label");
      const box = document.createElement("input");
      box.type = "checkbox";
      box.value = axis.name;
      box.addEventListener("change", choose);
      label.append(box, ` ${axis.name}`);
      return label;
    }));
    by("gain-axis").replaceChildren(...axes.map((axis) => new Option(axis.name, axis.name)));
    gainsBefore.clear();
    by("no-token").hidden = Boolean(token);
    choose();
  }

  // Set points of other axes mean nothing.
  function choose() {
    before = [];
    setTarget(null);
    by("command").value = "0";
    show();
  }

  take();
  by("off").addEventListener("click", off);
  by("reset").addEventListener("click", reset);
  by("set").addEventListener("click", apply);
  by("target").addEventListener("keydown", (event) => event.key === "Enter" && apply());
  by("undo").addEventListener("click", () => setTarget(before.length ? before.pop() : null));
  by("gain-set").addEventListener("click", () => setGain(Number(by("gain").value || NaN), false));
  by("gain").addEventListener("keydown", (event) => event.key === "Enter" && setGain(Number(by("gain").value || NaN), false));
  by("gain-undo").addEventListener("click", () => setGain(gainsBefore.get(by("gain-axis").value)?.at(-1), true));
  by("gain-axis").addEventListener("change", showGain);
  by("control-mode").addEventListener("change", show);
  by("command").addEventListener("input", show);
  const arm = by("arm");
  arm.addEventListener("pointerdown", (event) => {
    if (event.button !== 0) return;
    arm.setPointerCapture(event.pointerId);
    press();
  });
  for (const name of ["pointerup", "pointercancel", "lostpointercapture", "blur"]) arm.addEventListener(name, letGo);
  arm.addEventListener("contextmenu", (event) => event.preventDefault());
  arm.addEventListener("keydown", (event) => {
    if (event.key !== " " && event.key !== "Enter") return;
    event.preventDefault();
    if (!event.repeat) press();
  });
  arm.addEventListener("keyup", letGo);
  for (const name of ["blur", "pagehide", "offline"]) addEventListener(name, letGo);
  document.addEventListener("visibilitychange", () => document.hidden && letGo());
  setInterval(() => {
    if (!document.body.hasAttribute("data-controls") || !token || held || document.hidden) return;
    post("hello", {}).then(() => by("control-state").textContent || say("Ready: nothing is held.")).catch((error) => {
      say(`Not possible: ${error.message}`, true);
    });
  }, GREET);

  return { begin, see };
})();
