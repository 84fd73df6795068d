"use strict";
// Shows documents as they come. Text goes in as text, never as markup.
const BAND = 1.96, DEGREES = 180 / Math.PI, STALE_S = 3, KEPT = 900;
const ANGLES = new Set(["alpha", "beta", "roll", "pitch", "yaw"]);
const TILES = [["V", "airspeed", "m/s"], ["alpha", "angle of attack", "°"], ["beta", "sideslip", "°"],
  ["roll", "bank", "°"], ["pitch", "pitch", "°"], ["wind_north", "wind north", "m/s"],
  ["wind_east", "wind east", "m/s"], ["wind_down", "wind down", "m/s"]];
const COUNTED = { received: "received", recorded: "recorded", updates: "updates",
  decimated: "decimated", late: "late", frozen: "frozen", restarts: "restarts", reboots: "reboots", failures: "failures" };
let newest = null, arrived = 0, offered = 0, past = [];

const at = id => document.getElementById(id);
const scale = name => (ANGLES.has(name) ? DEGREES : 1);
function cell(tag, text, kind) {
  const element = document.createElement(tag);
  element.textContent = text;
  if (kind) element.className = kind;
  return element;
}
function digits(band) {
  return band > 0 && isFinite(band) ? Math.min(Math.max(1 - Math.floor(Math.log10(band)), 0), 6) : 3;
}
function told(value, sd) {
  if (value === null || value === undefined) return "–";
  if (sd === null || sd === undefined) return value.toPrecision(4);
  const places = digits(BAND * sd);
  return `${value.toFixed(places)} ± ${(BAND * sd).toFixed(places)}`;
}
function point(live) {
  const found = { t_us: live.written_us, age_s: live.state_age_s };
  for (const group of [live.state, live.coefficients])
    for (const [name, item] of Object.entries(group || {}))
      if (!(item.age_s > STALE_S)) found[name] = [item.value, item.sd];
  return found;
}
function tiles(live) {
  at("state").replaceChildren(...TILES.filter(([name]) => live.state[name]).map(([name, label, unit]) => {
    const item = live.state[name], by = scale(name), tile = cell("div", "", "tile");
    tile.dataset.name = name;
    tile.append(cell("span", label), cell("b", (by * item.value).toFixed(1).replace(/^-(0\.0)$/, "$1")),
      cell("span", `± ${(by * BAND * item.sd).toFixed(1)} ${unit}`));
    return tile;
  }));
}
function waiting(processes) {
  if (processes.phase !== "collecting") return processes.phase || "–";
  return `${processes.samples} of ${processes.wanted} samples`;
}
function inside(live) {
  const one = live.inside || {}, known = live.derivatives_by === "inside the filter";
  const words = {
    collecting: `collecting a minute of flight, ${(one.collected_s || 0).toFixed(0)} of ${one.wanted_s} s`,
    fitting: "fitting gusts, noise and derivatives to a minute of flight",
    known: known ? "airspeed, flow angles and derivatives shown here are its own"
      : one.age_s === null ? "beginning" : `catching up, ${(one.age_s || 0).toFixed(0)} s behind`,
  };
  at("inside").hidden = !one.phase || one.phase === "off";
  at("inside").textContent = `Aerodynamics inside the filter: ${words[one.phase] || one.phase}` +
    (one.lost ? `; begun anew ${one.lost} times.` : ".") + (one.refused ? ` Last: ${one.refused}.` : "");
  at("derivatives").textContent = `derivatives: ${live.derivatives_by || "first model"}`;
}
function model(live, late) {
  const rows = Object.entries(live.coefficients).map(([name, item]) => {
    const terms = Object.entries(live.derivatives[name] || {})
      .map(([key, term]) => cell("span", `${key === "1" ? "const" : key} ${told(term.value, term.sd)}`, "term"));
    const row = document.createElement("tr"), learned = cell("td", terms.length ? "" : "collecting", "wide");
    const processes = live.processes || {}, believed = (processes.coefficients || {})[name];
    row.dataset.name = name;
    learned.append(...terms);
    // Both are of the moment of the newest measured coefficient; derivatives do not grow old.
    const age = (item.age_s || 0) + late, kind = age > STALE_S ? "old" : "", measured = document.createElement("td");
    measured.append(cell("span", told(item.value, item.sd), kind));
    if (kind) measured.append(cell("span", ` ${age.toFixed(0)} s old`, "age"));
    row.append(cell("th", name), measured,
      cell("td", believed ? told(believed.value, believed.sd) : waiting(processes), believed ? kind : ""), learned);
    return row;
  });
  at("model").tBodies[0].replaceChildren(...rows);
}
function streams(live, late) {
  const health = live.health || {}, asked = health.requests || {};
  const names = new Set([...Object.keys(health.streams || {}), ...Object.keys(asked)]);
  at("streams").tBodies[0].replaceChildren(...[...names].sort().map(name => {
    const one = (health.streams || {})[name] || {}, want = asked[name] || {}, row = document.createElement("tr");
    const age = one.age_s === undefined ? null : one.age_s + late;
    if (name in asked && (age === null || age > STALE_S)) row.className = "stale-row";
    row.append(cell("td", name), cell("td", one.rate_hz === undefined ? "–" : one.rate_hz.toFixed(1)),
      cell("td", want.wanted_hz === undefined ? "" : want.wanted_hz.toFixed(0)),
      cell("td", age === null ? "never" : age.toFixed(1)), cell("td", want.answer || ""));
    return row;
  }));
  const lost = Object.entries(live.counts.lost).filter(([, n]) => n).map(([why, n]) => `${why} ${n}`);
  const latency = live.latency.packet_to_update;
  at("link").textContent = `${live.link}: ${health.up === false ? `down (${health.why})` : "up"}, ` +
    `broken ${health.losses || 0} times, silent for ${((health.silence_s || 0) + late).toFixed(1)} s`;
  at("counts").textContent = Object.entries(COUNTED).map(([key, word]) => `${live.counts[key] ?? 0} ${word}`)
    .concat(lost.length ? `lost: ${lost.join(", ")}` : "nothing lost",
      latency.p50_ms === null ? [] : `packet to update ${latency.p50_ms.toFixed(0)} ms (99 %: ${latency.p99_ms.toFixed(0)} ms)`).join(", ");
}
function alarms(live, late) {
  const words = [], health = live.health || {};
  const age = live.state_age_s === null ? null : live.state_age_s + late;
  if (late > STALE_S) words.push(`No news from listening for ${late.toFixed(0)} s.`);
  if (health.up === false) words.push(`Link lost: ${health.why}.`);
  if (age !== null && age > STALE_S) words.push(`Values are ${age.toFixed(0)} s old.`);
  for (const name of Object.keys(health.requests || {}).sort()) {
    const one = (health.streams || {})[name];
    if (one && one.age_s + late > STALE_S) words.push(`${name} stopped ${(one.age_s + late).toFixed(0)} s ago.`);
  }
  for (const [name, one] of Object.entries(live.departures || {}))
    words.push(`${name}${one.derivative ? ` by ${one.derivative}` : ""}: the simulation has departed for ${((live.time_us - one.since_us) / 1e6).toFixed(0)} s (${one.deviations.toFixed(1)} standard deviations).`);
  words.push(...(live.alarms || []).map(one => `${one.words[0].toUpperCase()}${one.words.slice(1)}.`));
  const refused = Object.entries(health.requests || {}).filter(([, one]) => one.answer === "refused").map(([name]) => name);
  if (refused.length) words.push(`The vehicle refuses ${refused.join(", ")}.`);
  if (live.other_vehicles.length) words.push(`Vehicle ${live.vehicle} is followed; heard too: ${live.other_vehicles.join(", ")}.`);
  const box = at("alarm");
  box.hidden = !words.length;
  box.textContent = words.join("\n");
  document.body.classList.toggle("stale", late > STALE_S || (age !== null && age > STALE_S));
}
function colour(name) { return getComputedStyle(document.documentElement).getPropertyValue(name).trim(); }
function prepared(canvas) {
  const ratio = window.devicePixelRatio || 1, width = canvas.clientWidth, height = canvas.clientHeight;
  canvas.width = width * ratio; canvas.height = height * ratio;
  const pen = canvas.getContext("2d");
  pen.scale(ratio, ratio); pen.font = "14px system-ui, sans-serif"; pen.fillStyle = colour("--quiet");
  return [pen, width, height];
}
function limits(values) {
  let low = Math.min(...values), high = Math.max(...values);
  const room = Math.max(0.08 * (high - low), 1e-4);
  return [low - room, high + room];
}
function history(canvas) {
  const name = canvas.dataset.name, by = scale(name), [pen, width, height] = prepared(canvas);
  const seen = past.map(p => (p[name] && p[name][0] !== null && !(p.age_s > STALE_S)
    ? [p.t_us / 1e6, by * p[name][0], by * BAND * (p[name][1] || 0)] : [p.t_us / 1e6, null, 0]));
  const known = seen.filter(p => p[1] !== null);
  if (known.length < 2) { pen.fillText("collecting", 8, 20); return; }
  const first = seen[0][0], last = Math.max(seen[seen.length - 1][0], first + 10);
  const [low, high] = limits(known.flatMap(p => [p[1] - p[2], p[1] + p[2]]));
  const left = 66, x = t => left + (t - first) / (last - first) * (width - left - 4);
  const y = v => 6 + (high - v) / (high - low) * (height - 28);
  const runs = [[]];
  for (const p of seen) p[1] === null ? runs.push([]) : runs[runs.length - 1].push(p);
  for (const run of runs.filter(r => r.length > 1)) {
    pen.beginPath();
    run.forEach((p, i) => pen[i ? "lineTo" : "moveTo"](x(p[0]), y(p[1] + p[2])));
    [...run].reverse().forEach(p => pen.lineTo(x(p[0]), y(p[1] - p[2])));
    pen.fillStyle = colour("--band"); pen.fill();
    pen.beginPath();
    run.forEach((p, i) => pen[i ? "lineTo" : "moveTo"](x(p[0]), y(p[1])));
    pen.strokeStyle = colour("--mark"); pen.lineWidth = 2; pen.stroke();
  }
  pen.fillStyle = colour("--ink");
  pen.fillText(high.toPrecision(3), 2, 18); pen.fillText(low.toPrecision(3), 2, height - 24);
  pen.fillText(`${(last - first).toFixed(0)} s`, width - 50, height - 4); pen.fillText("0", left, height - 4);
}
function plots() {
  document.querySelectorAll("canvas[data-name]").forEach(history);
  maps(newest);
}
function late() { return offered + (performance.now() - arrived) / 1000; }
function show() {
  if (!newest) return;
  at("aircraft").textContent = newest.aircraft;
  at("phase").textContent = newest.phase;
  const waited = Math.max(late() - 1.5, 0);
  tiles(newest); inside(newest); model(newest, waited); learning(newest); streams(newest, waited); alarms(newest, waited); plots();
}
function follow() {
  const events = new EventSource("/events");
  events.onmessage = event => {
    const news = JSON.parse(event.data);
    newest = news.document; offered = news.age_s || 0; arrived = performance.now();
    const last = past[past.length - 1];
    if (!last || last.t_us !== newest.written_us) past.push(point(newest));
    past = past.slice(-KEPT);
    show();
  };
}
