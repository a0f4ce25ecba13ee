// Looks at the page of `hydraxis monitor` in Chromium, as `.ci/page` starts it.
//
// usage: node page.mjs HYDRAXIS WORK [PICTURES]

import assert from "node:assert/strict";
import { spawn } from "node:child_process";
import { createServer, request } from "node:http";
import { readFileSync } from "node:fs";
import puppeteer from "puppeteer-core";

const [hydraxis, work, pictures] = process.argv.slice(2);
const PREFIX = `ci-page-${process.pid}`;
const axe = readFileSync(`${work}/node_modules/axe-core/axe.min.js`, "utf8");
const sleep = (ms) => new Promise((done) => setTimeout(done, ms));
const children = new Set();
const said = (text) => console.log(`page: ${text}`);

function start(options) {
  const child = spawn(hydraxis, options, { stdio: ["ignore", "pipe", "pipe"] });
  children.add(child);
  child.said = "";
  for (const stream of [child.stdout, child.stderr]) stream.on("data", (data) => (child.said += data));
  child.over = new Promise((done) => child.on("exit", done)).then(() => children.delete(child));
  return child;
}

async function until(what, look, patience = 30000) {
  const end = Date.now() + patience;
  for (;;) {
    const seen = await look();
    if (seen) return seen;
    assert(Date.now() < end, `waited ${patience} ms for ${what}`);
    await sleep(20);
  }
}

const group = () =>
  start(["run", "--prefix", PREFIX, "--duration", "20min", "--no-black-box", "--set", "timing.feedback_timeout=1s",
    "--set", "axis.boom.identification.estimator=auto"]);

async function monitor(address) {
  const child = start(["monitor", "--prefix", PREFIX, "--allow-control", "--listen", address]);
  await until("the address of the page", () => /control: (\S+)\s/.test(child.said));
  child.url = /control: (\S+)\s/.exec(child.said)[1];
  child.base = child.url.split("#")[0];
  return child;
}

const state = async (base) => (await fetch(`${base}state`)).json();

// A page of a browser, which fails for errors and for requests to elsewhere.
async function open(browser, bases) {
  const page = await browser.newPage();
  page.wrong = [];
  page.isExpected = () => false;
  page.on("pageerror", (error) => page.wrong.push(`error: ${error.message}`));
  page.on("console", (message) => {
    if (["error", "warn"].includes(message.type()) && !page.isExpected()) page.wrong.push(`console: ${message.text()}`);
  });
  page.on("request", (asked) => {
    if (!bases.some((base) => asked.url().startsWith(base))) page.wrong.push(`request: ${asked.url()}`);
  });
  return page;
}

const frames = (page) => page.evaluate(() => Number(document.body.dataset.frames));
const lamp = (page) => page.evaluate(() => document.body.dataset.state);

// Time from asking for the page to its first data. Other work of the computer only adds to it, so the least of some
// tries counts.
async function firstData(page, url) {
  await page.goto(url, { waitUntil: "domcontentloaded" });
  await until("the first data", () => frames(page));
  assert.equal(await page.evaluate(() => location.hash), "", "the token stays in the address");
  const times = [];
  for (let i = 0; i < 8 && !(times.at(-1) < 2000); i++) {
    const begin = Date.now();
    await page.reload({ waitUntil: "domcontentloaded" });
    await until("the first data", () => frames(page));
    times.push(Date.now() - begin);
  }
  said(`first data after ${times.join(", ")} ms`);
  assert(Math.min(...times) < 2000, "allowed: 2000 ms");
}

// What the cards say is what the server says of the same tick.
async function sameValues(page) {
  let compared = 0;
  await until("ten ticks that are shown and told", async () => {
    const { told, shown, tick } = await page.evaluate(async () => {
      const told = (await (await fetch("state")).json()).axes;
      const cards = [...document.querySelectorAll(".card")].map((card) => [...card.querySelectorAll("dd")].map((dd) => dd.textContent));
      return { told, tick: document.getElementById("tick").textContent, shown: cards };
    });
    if (String(told.tick) !== tick) return false;
    const signed = (value, decimals) => (value >= 0 ? "+" : "") + value.toFixed(decimals);
    told.axes.forEach((axis, i) => {
      const follows = ["model", "fallback"].includes(axis.command_by);
      assert.equal(shown[i][0], follows ? `${signed(1000 * axis.error, 1)} mm` : "-");
      assert.equal(shown[i][1], `${axis.position.toFixed(4)} m`);
      assert.equal(shown[i][3], signed(axis.command, 3));
    });
    compared += 1;
    return compared >= 10;
  });
  said(`${compared} ticks: the cards show what the server tells`);
}

// The rules of axe in both colours. The colours are set without a click, which would let a held button go.
async function accessible(page, what) {
  await page.evaluate(axe);
  const before = await page.evaluate(() => document.documentElement.dataset.theme);
  for (const theme of ["light", "dark"]) {
    await page.evaluate((theme) => (document.documentElement.dataset.theme = theme), theme);
    await sleep(300);
    const { violations, passes } = await page.evaluate(() =>
      axe.run(document, { runOnly: ["wcag2a", "wcag2aa", "wcag21aa", "best-practice"] }));
    const told = violations.map(({ id, nodes }) => `${id}: ${nodes.slice(0, 3).map((node) => node.html.slice(0, 120)).join(" | ")}`);
    said(`${what}, ${theme}: axe: ${passes.length} rules passed, ${violations.length} violated`);
    if (pictures) await page.screenshot({ path: `${pictures}/axe-${what.replaceAll(" ", "-")}-${theme}.png` });
    assert.deepEqual(told, []);
  }
  await page.evaluate((theme) => (document.documentElement.dataset.theme = theme), before);
}

async function open_all(page) {
  await page.evaluate(() => document.querySelectorAll("details").forEach((details) => (details.open = true)));
  await until("the models", () => page.evaluate(() => document.querySelectorAll("#model-table td").length > 6));
  await until("the weights", () => page.evaluate(() => document.querySelectorAll("#weight-table tbody tr").length > 6));
  const sum = await page.evaluate(() =>
    [...document.querySelectorAll("#weight-table td:last-child")].reduce((sum, cell) => sum + parseFloat(cell.textContent), 0));
  assert(Math.abs(sum - 100) < 1, `the weights are ${sum} % together`);
}

async function shoot(page, name, sizes) {
  if (!pictures) return;
  for (const [kind, width, height] of sizes) {
    await page.setViewport({ width, height });
    for (const theme of ["light", "dark"]) {
      if ((await page.evaluate(() => document.documentElement.dataset.theme)) !== theme) await page.click("#theme");
      await sleep(500);
      await page.screenshot({ path: `${pictures}/${name}-${kind}-${theme}.png`, fullPage: kind.startsWith("whole") });
    }
  }
  await page.setViewport({ width: 1280, height: 800 });
}

const SIZES = [["desk", 1280, 800], ["phone", 390, 844], ["tablet", 1024, 768], ["whole", 1280, 800], ["whole-phone", 390, 844]];

// Holds the button with the mouse until the boom is in manual mode, as the second monitor sees it.
async function press(page, eye) {
  await page.bringToFront();
  await page.evaluate(() => {
    document.querySelector("#control-axes input[value=boom]").checked = true;
    document.getElementById("control-mode").value = "manual";
    document.getElementById("control-mode").dispatchEvent(new Event("change"));
    document.getElementById("arm").scrollIntoView({ block: "center" });
  });
  await until("a press that holds", async () => {
    const box = await (await page.$("#arm")).boundingBox();
    await page.mouse.move(box.x + box.width / 2, box.y + box.height / 2);
    await page.mouse.down();
    for (let i = 0; i < 100; i++) {
      if ((await state(eye.base)).axes.axes[0].mode === "manual") return true;
      if (!(await page.evaluate(() => document.body.hasAttribute("data-held")))) break;
      await sleep(20);
    }
    await page.mouse.up();
    return false;
  });
}

async function off(eye, way, lost) {
  await until(`off: ${way}`, async () => {
    const boom = (await state(eye.base)).axes.axes[0];
    return boom.mode === "off" && boom.command === 0;
  });
  const took = Date.now() - lost;
  // The second monitor sees a state each 0.1 s.
  said(`${way}: off, seen after ${took} ms`);
  assert(took < 1500, `${way}: ${took} ms`);
}

// One parameter of an axis that is off, and back; refused while another one is held, and outside of its range.
async function tune(page, eye) {
  const gain = async () => (await state(eye.base)).axes.axes[0].gain;
  const set = async (value) => {
    await page.$eval("#gain", (input, value) => (input.value = value), value);
    await page.evaluate(() => document.getElementById("gain-set").click());
  };
  await until("an axis whose gains can be set", () => page.evaluate(() => !document.getElementById("gain-set").disabled));
  await set("0.8");
  await until("gains of 0.8", async () => (await gain()) === 0.8);
  await set("77");
  await until("a refusal", () => page.evaluate(() => /allowed/.test(document.getElementById("control-state").textContent)));
  said(`gains of 77: ${await page.evaluate(() => document.getElementById("control-state").textContent)}`);
  await until("undo", () => page.evaluate(() => !document.getElementById("gain-undo").disabled));
  if (pictures) {
    await page.$eval("#control", (section) => section.scrollIntoView());
    await page.screenshot({ path: `${pictures}/gains.png` });
  }
  await page.evaluate(() => document.getElementById("gain-undo").click());
  await until("the gains of the machine file", async () => (await gain()) === 1);
  said("gains set and undone");
}

async function control(browser, page, server, eye) {
  page.isExpected = () => true;
  // Axes that track are switched off first.
  await page.evaluate(() => document.getElementById("off").click());
  await off(eye, "OFF", Date.now());
  await tune(page, eye);
  await press(page, eye);
  // The judge keeps the page busy, so its heartbeat may fail and the axis is off then, as it has to be.
  await accessible(page, "held");
  await page.mouse.up();
  await off(eye, "button released after the judge", Date.now());

  await press(page, eye);
  await until("the page to say that it holds", () =>
    page.evaluate(() => document.getElementById("control-state").textContent.includes("while you hold the button")));
  if (pictures) await page.screenshot({ path: `${pictures}/held.png` });
  let lost = Date.now();
  await page.mouse.up();
  await off(eye, "button released", lost);

  await press(page, eye);
  lost = Date.now();
  const frozen = page.evaluate(() => {
    for (const end = performance.now() + 3000; performance.now() < end; );
  });
  await off(eye, "page frozen", lost);
  await frozen;
  await until("the page to notice it", () => page.evaluate(() => !document.body.hasAttribute("data-held")));
  const { why } = await page.evaluate(() => ({ why: document.getElementById("control-state").textContent }));
  said(`after the freeze the page says: ${why}`);
  await page.mouse.up();

  await press(page, eye);
  const other = await browser.newPage();
  lost = Date.now();
  await other.bringToFront();
  await off(eye, "tab hidden", lost);
  await other.close();
  await page.mouse.up();

  await press(page, eye);
  lost = Date.now();
  await page.setOfflineMode(true);
  await off(eye, "network cut", lost);
  await page.setOfflineMode(false);
  await page.mouse.up();

  await press(page, eye);
  lost = Date.now();
  server.kill("SIGKILL");
  await off(eye, "server killed", lost);
  await page.mouse.up();
  // Nothing that the page says later hides that an OFF was not answered.
  await page.evaluate(() => document.getElementById("off").click());
  await sleep(3500);
  const alarm = await page.evaluate(() => document.getElementById("control-state").textContent);
  assert(alarm.startsWith("OFF WAS NOT ANSWERED"), alarm);
}

// Axes that an emergency stop has latched, until they are reset from the page.
async function latch(page) {
  const stop = start(["disarm", "--emergency", "--prefix", PREFIX]);
  await stop.over;
  await until("latched axes", () => page.evaluate(() => document.querySelectorAll(".card[data-look=bad]").length === 4));
  await until("the fault in the list", () => page.evaluate(() => document.querySelector("#event-list .fault")));
  await accessible(page, "latched");
  await page.evaluate(() => document.querySelectorAll("#control-axes input").forEach((box) => box.click()));
  await page.evaluate(() => document.getElementById("reset").click());
  await until("released axes", () => page.evaluate(() => !document.querySelector(".card[data-look=bad]")));
  await page.evaluate(() => document.querySelectorAll("#control-axes input").forEach((box) => box.click()));
  said("latched axes are reset from the page");
}

// An hour of states, as fast as the page takes them, through a server that has the page of the real one.
async function hour(browser, base) {
  const template = await state(base);
  const port = Number(new URL(base).port);
  let feed = null;
  const server = createServer((asked, answer) => {
    if (asked.url === "/events") {
      answer.writeHead(200, { "content-type": "text/event-stream" });
      return void (feed = answer);
    }
    request({ port, path: asked.url, headers: { host: `127.0.0.1:${port}` } }, (from) => {
      answer.writeHead(from.statusCode, from.headers);
      from.pipe(answer);
    }).end();
  });
  await new Promise((done) => server.listen(0, "127.0.0.1", done));
  const own = `http://127.0.0.1:${server.address().port}/`;
  const page = await open(browser, [own]);
  await page.goto(own, { waitUntil: "domcontentloaded" });
  await until("the page's connection", () => feed);
  const send = async (name, body) => {
    if (!feed.write(`event: ${name}\ndata: ${JSON.stringify(body)}\n\n`)) await new Promise((done) => feed.once("drain", done));
  };
  const heap = async () => {
    const session = await page.createCDPSession();
    await session.send("HeapProfiler.collectGarbage");
    const { usedSize } = await session.send("Runtime.getHeapUsage");
    const nodes = await page.evaluate(() => document.querySelectorAll("*").length);
    await session.detach();
    return { MB: usedSize / 1e6, nodes };
  };
  await send("hello", template.hello);
  const sizes = [];
  const begin = Date.now();
  for (let i = 1; i <= 36000; i++) {
    const t = i / 10;
    template.axes.unix_ms += 100;
    template.axes.tick += 10;
    template.axes.age_ns = 1e6;
    template.axes.axes.forEach((axis, k) => {
      axis.error = 0.01 * Math.sin(t + k);
      axis.position = 0.6 + 0.1 * Math.sin(t / 3 + k);
    });
    await send("axes", template.axes);
    if (i % 5 === 0) await send("stages", template.stages);
    if (i % 7000 === 0 || i === 36000) {
      await until("the page to take all", async () => (await frames(page)) >= i, 120000);
      sizes.push(await heap());
    }
  }
  const [first, last] = [sizes[0], sizes.at(-1)];
  said(`an hour of states in ${((Date.now() - begin) / 1000).toFixed(0)} s: heap ${sizes.map(({ MB }) => MB.toFixed(1)).join(", ")} MB, elements ${first.nodes}, ${last.nodes}`);
  // After 700 s the trends are full: what comes later must replace what was there.
  assert(last.MB < 1.1 * first.MB + 1, "the page grows");
  assert.equal(last.nodes, first.nodes);
  assert.deepEqual(page.wrong, []);
  await page.close();
  server.closeAllConnections();
  server.close();
}

async function main() {
  let running = group();
  let server = await monitor("127.0.0.1:0");
  const eye = await monitor("127.0.0.1:0");
  await until("the group", async () => (await fetch(`${server.base}health`)).status === 200);
  const browser = await puppeteer.launch({
    executablePath: "/usr/bin/chromium",
    args: ["--no-sandbox", "--disable-gpu", "--hide-scrollbars"],
    userDataDir: `${work}/profile`,
  });
  try {
    const page = await open(browser, [server.base]);
    await page.setViewport({ width: 1280, height: 800 });
    await firstData(page, server.url);
    await sameValues(page);
    if (pictures) await sleep(15000);
    await shoot(page, "first", SIZES);
    if (pictures) {
      if ((await page.evaluate(() => document.documentElement.dataset.theme)) !== "light") await page.click("#theme");
      await (await page.$("#drawing")).screenshot({ path: `${pictures}/machine.png` });
    }
    await open_all(page);
    await accessible(page, "live");
    if (pictures) await sleep(25000);
    await shoot(page, "details", SIZES);
    await hour(browser, server.base);
    await page.bringToFront();
    assert.deepEqual(page.wrong, []);

    page.isExpected = () => true;
    running.kill("SIGINT");
    await until("the page to say that the group has ended", async () => (await lamp(page)) === "absent");
    await running.over;
    await shoot(page, "absent", SIZES.slice(0, 1));
    await accessible(page, "absent");
    running = group();
    await until("the page to come back with the group", async () => (await lamp(page)) === "live");
    said("back with the next group");
    await latch(page);

    await control(browser, page, server, eye);
    await until("the page to say that the server is gone", async () => (await lamp(page)) === "lost");
    await accessible(page, "lost");
    const address = new URL(server.base).host;
    server = await monitor(address);
    await until("the page to come back with the server", async () => (await lamp(page)) === "live");
    assert(page.wrong.every((line) => !line.startsWith("request") && !line.startsWith("error")), page.wrong.join("\n"));
    said("back with the next server");
  } finally {
    await browser.close();
  }
  running.kill("SIGINT");
  await running.over;
  for (const child of [server, eye]) child.kill("SIGINT");
  await Promise.all([server.over, eye.over]);
}

try {
  await main();
  said("all is well");
} finally {
  // In order, so that nothing stays in shared memory; who does not end is killed.
  for (const child of children) child.kill("SIGINT");
  await Promise.race([Promise.all([...children].map((child) => child.over)), sleep(10000)]);
  for (const child of children) child.kill("SIGKILL");
}
