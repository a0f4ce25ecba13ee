// All machines, once a second. What comes from the network is only ever put in as text.
"use strict";

// Time between two questions, and the age from which an answer counts as old, ms.
const APART = 1000;
const OLD = 3000;
const WORDS = { live: "live", stale: "STALE", "no-group": "no group", gone: "GONE", clock: "CLOCK" };

const state = document.getElementById("state");
const body = document.getElementById("machines");
let rows = [];
let answered = null;

function cell(row, text, kind) {
  const cell = row.insertCell();
  cell.textContent = text;
  if (kind) cell.className = kind;
  return cell;
}

function age(row, key, since) {
  const age = row.age_s[key];
  return age === undefined ? "-" : `${(age + since).toFixed(age + since < 10 ? 2 : 0)} s`;
}

function axes(row, cell) {
  const list = document.createElement("ul");
  for (const axis of row.axes) {
    const item = document.createElement("li");
    const position = axis.position === null ? "-" : `${axis.position.toFixed(4)} m`;
    const flags = axis.flags.length ? ` (${axis.flags.join(", ")})` : "";
    item.textContent = `${axis.name}: ${axis.mode}, ${position}, command ${axis.command.toFixed(3)}${flags}`;
    list.append(item);
  }
  cell.append(list);
}

function show() {
  const since = answered === null ? Infinity : performance.now() - answered;
  const isOld = since > OLD;
  if (answered !== null) {
    const count = rows.length === 1 ? "1 machine" : `${rows.length} machines`;
    state.textContent = isOld ? `No answer for ${Math.round(since / 1000)} s: nothing below is of now.` : `${count}.`;
    state.className = isOld ? "bad" : "";
  }
  document.querySelector("table").className = isOld ? "old" : "";
  const seconds = Math.min(since, 1e9) / 1000;
  body.replaceChildren();
  for (const row of rows) {
    const isLive = row.state === "live" && !isOld;
    const line = body.insertRow();
    cell(line, row.site);
    cell(line, row.machine);
    cell(line, isOld && row.state === "live" ? "unknown" : WORDS[row.state] ?? row.state, isLive ? "live" : "bad");
    cell(line, row.group ?? "-");
    cell(line, age(row, "telemetry/encoder-sample", seconds));
    cell(line, age(row, "status", seconds));
    cell(line, age(row, "model", seconds));
    axes(isLive ? row : { axes: [] }, cell(line, ""));
    const { lost, late, unknown, malformed, repeated } = row.counts;
    for (const count of [lost, late, unknown + malformed + repeated, row.unread, row.overwritten]) {
      cell(line, count, count ? "" : "quiet");
    }
    cell(line, row.clock_error_s === null ? "not synchronised" : `${(1000 * row.clock_error_s).toFixed(1)} ms`);
    const event = row.event;
    cell(line, event ? [event.axis, event.kind, event.text].filter((part) => part).join(": ") : "-");
  }
}

async function look() {
  try {
    const answer = await fetch("machines.json", { signal: AbortSignal.timeout(OLD) });
    if (answer.ok) {
      rows = await answer.json();
      answered = performance.now();
    }
  } catch {
    // An answer that does not come shows by its age.
  }
  show();
  setTimeout(look, APART);
}

look();
setInterval(show, APART);
