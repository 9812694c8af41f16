// Ask the server for what is new, ten times a second, and show it. Texts are set as text, never as markup.

import { Charts, Overview } from "./charts.js";

const PERIOD = 100, HIDDEN_PERIOD = 1000, LIST_PERIOD = 1000, OVERVIEW_PERIOD = 1000, SAID_TIME = 12000;
const NEAR = 0.8, AT_LIMIT = 0.95, SILENT = 3.5;
const SCALES = { m: [1e3, "mm"], N: [1e-3, "kN"] };
const NODE_COLOURS = { running: "good", ready: "good", waiting: "care", tripped: "alarm" };

const place = (id) => document.getElementById(id);
const token = takeToken();
const page = { run: null, chosen: false, at: null, span: 5, view: null, buffer: null, control: false, overview: [[], []], said: 0 };
const charts = new Charts(), overview = new Overview(place("overview"));
let overviewDue = 0, played = null;

/** The token stands behind the # of the address; it is kept for this tab and taken out of sight. */
function takeToken() {
  if (location.hash.length > 1) {
    sessionStorage.setItem("token", location.hash.slice(1));
    history.replaceState(null, "", location.pathname);
  }
  return sessionStorage.getItem("token") ?? "";
}

function element(tag, text = "", attributes = {}) {
  const made = document.createElement(tag);
  made.textContent = text;
  for (const [name, value] of Object.entries(attributes)) made.setAttribute(name, value);
  return made;
}

const known = (value) => value !== null && value !== undefined;
const digits = (value, n = 3) => (known(value) ? Number(value).toLocaleString("en", { maximumSignificantDigits: n, useGrouping: false }) : "–");
const fixed = (value, n) => (known(value) ? value.toFixed(n) : "–");

// ---- from the server

async function get(path) {
  const response = await fetch(path, { cache: "no-store" });
  if (!response.ok) throw new Error(`${response.status}`);
  return response.json();
}

/** Keep the steps of the window; a view brings those that are missing. */
function buffered(signals, at, span) {
  const old = page.buffer;
  const { first, ...columns } = signals;
  const { floor_accelerations: floors, ...scalars } = columns;
  const count = scalars.command.length;
  if (old === null || first !== old.end || floors.length !== old.floors.length || old.run !== page.run) {
    page.buffer = { run: page.run, first, end: first + count, scalars, floors };
  } else {
    const drop = Math.max(0, Math.min(at - Math.ceil(span), old.end) - old.first);
    const joined = (before, more) => before.slice(drop).concat(more);
    for (const name of Object.keys(scalars)) old.scalars[name] = joined(old.scalars[name], scalars[name]);
    old.floors = old.floors.map((floor, i) => joined(floor, floors[i]));
    old.first += drop;
    old.end += count;
  }
  return page.buffer;
}

async function look() {
  const now = performance.now();
  if (page.run === null) return;
  const continues = page.buffer !== null && page.buffer.run === page.run && (page.at === null || page.at >= page.buffer.end) && page.buffer.span === page.span;
  const query = new URLSearchParams({ run: page.run, since: continues ? page.buffer.end : 0, span: page.span });
  if (page.at !== null) query.set("at", Math.round(page.at));
  if (now >= overviewDue) query.set("overview", "1");
  const asked = page.run;
  const view = await get(`/api/view?${query}`);
  if (asked !== page.run) return;
  if (view.overview) {
    page.overview = view.overview;
    overviewDue = now + OVERVIEW_PERIOD;
  }
  try {
    show(view);
  } catch (error) {
    console.error(error);
    banner({ word: "PAGE ERROR", sentence: `${error.message}; what is shown may be old`, colour: "alarm" });
  }
}

async function list() {
  const found = await get("/api/recordings");
  page.list = found;
  page.control = found.control;
  if (!page.chosen && found.bags.length > 0 && found.bags[0].id !== page.run) choose(found.bags[0].id, false);
  if (found.bags.length === 0) banner({ word: "NO TEST", sentence: "waiting for a recording", colour: "quiet" });
}

function choose(run, byHand) {
  Object.assign(page, { run, chosen: byHand, at: null, buffer: null, view: null, overview: [[], []] });
  overviewDue = 0;
  document.title = "bmd_rths";
}

async function forever(work, period) {
  for (;;) {
    try {
      await work();
      page.lost = false;
    } catch {
      lost();
    }
    await new Promise((wake) => setTimeout(wake, document.hidden ? HIDDEN_PERIOD : period));
  }
}

function lost() {
  page.lost = true;
  place("control").hidden = true;
  const outcome = page.view?.story?.outcome;
  if (outcome) place("sentence").textContent = `${page.view.banner.sentence} (the run has ended, and its page with it)`;
  else banner({ word: "NO CONNECTION", sentence: "what is shown is old", colour: "alarm" });
}

// ---- to the table

async function ask(button, what) {
  button.classList.add("asked");
  const before = page.said;
  try {
    const response = await fetch(`/api/${what}`, { method: "POST", headers: { "X-Bmd-Rths-Token": token } });
    const refused = `${await response.clone().text()}; open the page by the address on the terminal`;
    const answer = response.ok ? (await response.json()).answer : refused;
    if (!response.ok || page.said === before) say(answer); // what the table driver itself says is more
  } catch {
    say("NO ANSWER: use the terminal (Ctrl-C) or the emergency stop of the hydraulics");
  }
  setTimeout(() => button.classList.remove("asked"), 1500);
}

function say(text) {
  const said = place("said");
  said.textContent = text;
  said.hidden = false;
  clearTimeout(say.timer);
  say.timer = setTimeout(() => { said.hidden = true; }, SAID_TIME);
}

// ---- on the screen

function show(view) {
  if (view.said_count > page.said) say(view.said.at(-1));
  page.said = view.said_count;
  if (view.banner) banner(view.banner);
  page.view = view;
  place("control").hidden = !(page.control && token && view.live !== false);
  if (!view.signals) return;
  const { story, at } = view, dt = story.time_step;
  const buffer = buffered(view.signals, at, page.span / dt);
  buffer.span = page.span;
  const length = buffer.end - buffer.first;
  const x = Array.from({ length }, (_, k) => (buffer.first + k) * dt);
  charts.draw({
    view, x, dt, times: [Math.max(0, view.time - page.span), Math.max(view.time, Math.min(page.span, total(view) * dt))],
    at: (name, shift = (column) => column) => shift(buffer.scalars[name]),
    floors: () => buffer.floors,
  });
  place("motion").textContent = `${story.motion} · ${story.scheme}`;
  place("about").textContent = `${story.controller} table · Δt ${digits(1e3 * dt)} ms`;
  document.title = `${view.banner.word} · ${story.motion}`;
  tiles(view);
  limits(view.limits);
  nodes(view);
  events(view, dt);
  timeBar(view, dt);
}

function banner({ word, sentence, colour }) {
  place("banner").dataset.colour = colour;
  if (place("word").textContent !== word) place("word").textContent = word;
  place("sentence").textContent = sentence;
}

function tiles(view) {
  const { story, tracking, snapshot, time } = view;
  const test = snapshot.test ?? {}, closure = test.closure_ms ?? {}, stability = view.limits.at(-1);
  const last = (name) => tracking[name].at(-1);
  const used = view.limits.filter((limit) => limit.watched && known(limit.now)).sort((one, other) => other.now / other.limit - one.now / one.limit)[0];
  const share = used ? used.now / used.limit : null;
  const planned = story.planned_steps ? `of ${fixed(story.planned_steps * story.time_step, 1)} s · ` : "";
  put("tiles", [
    ["test time", fixed(time, 1), "s", `${planned}step ${view.at}`],
    ["tracking error", digits(last("error_percent")), "%", "over 2 s, with noise"],
    ["delay", fixed(last("delay_ms"), 1), "ms", "of the table, over 2 s"],
    ["amplitude", fixed(last("amplitude"), 2), "", `tracking indicator ${fixed(last("indicator"), 2)}`],
    ["nearest limit", known(share) ? digits(100 * share, 2) : "–", "%", used?.words ?? "", shade(share)],
    ["stability", digits(stability.now, 2), "", `limit ${digits(stability.limit)}`, shade(stability.watched && known(stability.now) ? stability.now / stability.limit : 0)],
    ["missed deadlines", digits(test.missed_deadlines, 6), "", known(test.max_consecutive_misses) ? `at most ${test.max_consecutive_misses} in a row` : "", late(test, view)],
    ["closure p99", fixed(closure.p99, 2), "ms", `p50 ${fixed(closure.p50, 2)}, max ${fixed(closure.max, 2)}`],
  ].map(([label, value, unit, note, tint]) => {
    const tile = element("div", "", { "data-colour": tint ?? "", "data-name": label });
    const number = element("dd", value);
    number.append(element("i", unit));
    tile.append(element("dt", label), number, element("p", note));
    return tile;
  }));
}

/** One step in a hundred may be late (`LARGEST_LATE_SHARE`). */
const late = ({ missed_deadlines: missed }, { at }) => (missed > 0.01 * at ? "alarm" : missed > 0 ? "care" : "");
const shade = (share) => (!known(share) || share < NEAR ? "" : share < AT_LIMIT ? "care" : "alarm");
const put = (id, children) => place(id).replaceChildren(...children);

function limits(found) {
  put("limits", found.flatMap(({ words, unit, limit, now, peak, watched }) => {
    const [scale, shown] = SCALES[unit] ?? [1, unit];
    const percent = (value) => `${Math.min(100, (100 * (value ?? 0)) / limit)}%`;
    const off = watched ? "" : "off";
    const track = element("div", "", { class: `track ${off} ${watched ? shade((now ?? 0) / limit) : ""}` });
    const fill = element("div", "", { class: "fill" }), mark = element("div", "", { class: "peak" });
    fill.style.width = percent(now);
    mark.style.left = percent(peak);
    track.append(fill, mark);
    const left = known(now) ? `${digits(scale * Math.abs(limit - now))} ${shown} ${now > limit ? "over" : "left"}` : "not told";
    const title = `now ${digits(scale * now)}, peak ${digits(scale * peak)}, limit ${digits(scale * limit)} ${shown}`;
    return [element("span", watched ? words : `${words} · off`, { class: off }), track, element("b", left, { title, class: off, "data-name": words })];
  }));
}

function nodes({ snapshot, live, at, steps }) {
  const told = Object.entries(snapshot.nodes);
  if (told.length === 0) put("nodes", [element("span", "none has told anything", { class: "why" })]);
  else put("nodes", told.map(([role, node]) => {
    const silent = live && at === steps && node.told_s_ago > SILENT && !["ended", "inactive"].includes(node.state);
    const row = element("div", "", { "data-colour": silent ? "alarm" : NODE_COLOURS[node.state] ?? "quiet", title: node.message });
    row.append(element("span", role.replaceAll("_", " ")), element("b", silent ? `silent ${Math.round(node.told_s_ago)} s` : node.state ?? "–"));
    return row;
  }));
}

function events(view, dt) {
  const said = view.said.map((text) => ({ step: null, level: "warning", text })).reverse();
  const shown = [...said, ...[...view.events].reverse()];
  const key = JSON.stringify(shown);
  if (events.key === key) return; // so that the list can be scrolled
  events.key = key;
  put("events", shown.map(({ step, level, text }) => {
    const row = element("li", "", { class: level });
    row.append(element("time", step === null ? "operator" : `${(step * dt).toFixed(2)} s`), element("span", text));
    return row;
  }));
}

/** Steps of the whole test, of one that runs as it is planned. */
const total = (view) => Math.max(view.steps, view.live ? view.story.planned_steps ?? 0 : 0);

function timeBar(view, dt) {
  const slider = place("time"), last = total(view);
  slider.max = last;
  if (document.activeElement !== slider || page.at === null) slider.value = view.at;
  place("clock").textContent = `${fixed(view.time, 2)} / ${fixed(last * dt, 1)} s`;
  place("live").setAttribute("aria-pressed", page.at === null);
  place("live").textContent = view.live ? "LIVE" : "END";
  overview.draw(page.overview, last * dt, [view.time - page.span, view.time]);
}

// ---- recordings

const heading = (name) => name.replace(/_percent$/, " [%]").replace(/_ms$/, " [ms]").replace("rmse", "RMSE").replaceAll("_", " ");

function showRecordings() {
  const { bags, campaign } = page.list ?? { bags: [], campaign: null };
  const names = new Map(bags.map((bag) => [bag.id, bag.name]));
  const open = (id, text) => {
    const button = element("button", text, { type: "button" });
    button.onclick = () => { choose(id, true); place("recordings").close(); };
    return button;
  };
  const table = element("table");
  const row = (tag, cells) => {
    const made = element("tr");
    for (const cell of cells) {
      const text = typeof cell === "string" ? cell : "";
      const number = text !== "" && !Number.isNaN(Number(text));
      const made_cell = element(tag, number ? digits(Number(text), 4) : text, number ? { class: "number" } : {});
      if (typeof cell !== "string") made_cell.append(cell);
      made.append(made_cell);
    }
    return made;
  };
  if (campaign === null) table.append(...bags.map((bag) => row("td", [open(bag.id, bag.name)])));
  else {
    table.append(row("th", ["", ...campaign.columns.map(heading)]));
    campaign.rows.forEach((cells, i) => table.append(row("td", [names.has(campaign.ids[i]) ? open(campaign.ids[i], "show") : "no bag", ...cells.map((cell) => (cell === "{}" ? "" : cell))])));
  }
  put("list", [table]);
  place("recordings").showModal();
}

// ---- controls

function theme(name) {
  document.documentElement.dataset.theme = name;
}

function seek(at) {
  page.at = at;
}

function play(now) {
  if (played !== null && page.at !== null && page.view?.story) {
    seek(page.at + (now - played) / 1000 / page.view.story.time_step);
    if (page.at >= page.view.steps) { seek(null); stopPlaying(); return; }
  }
  if (played !== null) { played = now; requestAnimationFrame(play); }
}

function stopPlaying() {
  played = null;
  place("play").textContent = "▶";
}

place("stop").onclick = (event) => ask(event.currentTarget, "stop");
place("emergency_stop").onclick = (event) => ask(event.currentTarget, "emergency_stop");
place("live").onclick = () => { stopPlaying(); seek(null); };
place("time").oninput = (event) => { stopPlaying(); seek(Math.min(Number(event.target.value), page.view?.steps ?? 0)); };
place("span").onchange = (event) => { page.span = Number(event.target.value); page.buffer = null; };
place("play").onclick = () => {
  if (played !== null) { stopPlaying(); return; }
  if (page.at === null) seek(0);
  place("play").textContent = "❚❚";
  played = performance.now();
  requestAnimationFrame(play);
};
place("choose").onclick = showRecordings;
place("theme").onclick = () => {
  theme(document.documentElement.dataset.theme === "dark" ? "light" : "dark");
  localStorage.setItem("theme", document.documentElement.dataset.theme);
};
theme(localStorage.getItem("theme") ?? (matchMedia("(prefers-color-scheme: dark)").matches ? "dark" : "light"));

globalThis.monitorPage = { page, charts, seek };
forever(list, LIST_PERIOD);
forever(look, PERIOD);
