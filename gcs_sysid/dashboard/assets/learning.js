"use strict";
// What the flight teaches: the maneuver in progress, the confidence map, causes, suggestions.
const NAMES = { alpha: "angle of attack [°]", beta: "sideslip [°]" };
const CAUSES = { surface_effectiveness: "effect of the", surface_offset: "offset of the", mass: "mass",
  inertia: "inertia", cg_shift: "centre of gravity", airspeed_scale: "scale of the airspeed", drag_increase: "drag or thrust",
  asymmetry: "asymmetry", aero_derivative: "derivative" };
let coefficient = null;

function sized(cause) {
  const by = cause.unit === "rad" ? DEGREES : cause.unit === "1" && !/0$/.test(cause.about) ? 100 : 1;
  const unit = cause.unit === "rad" ? "°" : by === 100 ? "%" : cause.unit === "1" ? "" : cause.unit;
  return `${by * cause.size > 0 ? "+" : ""}${told(by * cause.size, by * cause.sd)} ${unit}`;
}
// Nothing is certain: "97 %", "99.6 %", "> 99.9 %".
function probable(share) {
  const percent = 100 * share;
  if (percent > 99.9) return "> 99.9 %";
  if (percent < 0.1) return "< 0.1 %";
  return `${percent.toFixed(percent < 1 || percent > 99 ? 1 : 0)} %`;
}
function causes(live) {
  const list = live.causes || [];
  at("causes").hidden = !list.length;
  at("causes").querySelector("ol").replaceChildren(...list.map(one => cell("li",
    `${[CAUSES[one.cause] || one.cause, one.about].join(" ").trim()}: ${sized(one)} (${probable(one.probability)})`)));
}
function suggested(live) {
  const list = live.suggestions || [];
  at("suggestions").querySelector("ol").replaceChildren(...(list.length
    ? list.map(one => cell("li", `${one.fly} — for ${one.for.join(", ")}`))
    : [cell("li", Object.keys(live.derivatives).length ? "nothing: every derivative is known to a quarter of its value" : "collecting")]));
}
function maneuver(live) {
  const one = live.maneuver, box = at("maneuver"), flown = (live.maneuvers || []).length;
  box.classList.toggle("on", Boolean(one));
  box.classList.toggle("done", Boolean(one && one.stop));
  at("maneuver-name").textContent = one ? `Maneuver ${one.number}: ${one.controls.join(", ")}, ${one.seconds.toFixed(0)} s`
    : `No maneuver in progress; ${flown} flown`;
  at("maneuver-stop").textContent = !one ? "" : one.stop ? `STOP: ${one.stop}` : "go on";
  at("gauge").value = one ? one.learned : 0;
  at("gauge-share").textContent = one ? `${(100 * one.learned).toFixed(0)} % learned by the first model` : "";
  at("gauge-rows").replaceChildren(...(one ? one.gauge : []).map(row => cell("span",
    `${row.derivative} ${told(row.value, row.sd)} (wanted\u00a0±\u00a0${(BAND * row.sd_wanted).toPrecision(2)})`, "term")));
}
function chooser(live) {
  const first = (live.map.planes[0] || { share_of_spread: {} }).share_of_spread, names = Object.keys(first);
  if (names.length && !names.includes(coefficient)) coefficient = names.includes("Cm") ? "Cm" : names[0];
  const box = at("chooser");
  if (box.dataset.names === names.join()) return;
  box.dataset.names = names.join();
  box.replaceChildren(...names.map(name => {
    const button = cell("button", name);
    button.type = "button";
    button.setAttribute("aria-pressed", String(name === coefficient));
    button.onclick = () => {
      coefficient = name;
      box.querySelectorAll("button").forEach(b => b.setAttribute("aria-pressed", String(b.textContent === name)));
      maps(newest);
    };
    return button;
  }));
}
function axis(name, value) { return (scale(name) === 1 && name !== "V" ? DEGREES * value : scale(name) * value).toFixed(0); }
function plane(canvas, one, map) {
  const [pen, width, height] = prepared(canvas), left = 44, foot = 26, across = one.x_edges.length - 1, up = one.y_edges.length - 1;
  const w = (width - left - 6) / across, h = (height - foot - 8) / up, share = one.share_of_spread[coefficient];
  for (let i = 0; i < across; i++) for (let j = 0; j < up; j++) {
    const x = left + i * w, y = 8 + (up - 1 - j) * h, seconds = one.seconds[i][j], visited = seconds >= map.least_s;
    const known = visited && share && share[i][j] <= map.level;
    pen.fillStyle = colour(known ? "--mark" : visited ? "--amber" : seconds > 0 ? "--band" : "--paper");
    pen.fillRect(x, y, w - 2, h - 2);
    if (visited && !known) {  // told apart without colour too
      pen.strokeStyle = colour("--paper"); pen.lineWidth = 2; pen.beginPath();
      pen.moveTo(x + 2, y + h - 4); pen.lineTo(x + w - 4, y + 2); pen.stroke();
    }
  }
  pen.fillStyle = colour("--ink");
  pen.fillText(axis(one.y, one.y_edges[up]), 2, 20); pen.fillText(axis(one.y, one.y_edges[0]), 2, height - foot - 2);
  pen.fillText(axis(one.x, one.x_edges[0]), left, height - 6);
  const last = axis(one.x, one.x_edges[across]);
  pen.fillText(last, width - 6 - pen.measureText(last).width, height - 6);
}
function speeds(canvas, map) {
  const [pen, width, height] = prepared(canvas), left = 44, bars = map.speed.seconds, most = Math.max(...bars, 1), w = (width - left - 6) / bars.length;
  pen.fillStyle = colour("--mark");
  bars.forEach((seconds, i) => pen.fillRect(left + i * w, height - 26 - seconds / most * (height - 40), w - 2, seconds / most * (height - 40)));
  pen.fillStyle = colour("--ink");
  pen.fillText(`${most.toFixed(0)} s`, 2, 20);
  pen.fillText(map.speed.edges[0].toFixed(0), left, height - 6);
  const last = map.speed.edges[bars.length].toFixed(0);
  pen.fillText(last, width - 6 - pen.measureText(last).width, height - 6);
}
function maps(live) {
  if (!live || !live.map) return;
  chooser(live);
  at("map-by").textContent = live.map.by ? `by the ${live.map.by}` : "";
  const box = at("map");
  while (box.children.length < live.map.planes.length + 1) {
    const figure = document.createElement("figure");
    figure.append(document.createElement("figcaption"), document.createElement("canvas"));
    box.append(figure);
  }
  live.map.planes.forEach((one, k) => {
    box.children[k].firstChild.textContent = `${NAMES[one.y] || `${one.y} [°]`} over ${NAMES[one.x] || one.x}`;
    plane(box.children[k].lastChild, one, live.map);
  });
  box.children[live.map.planes.length].firstChild.textContent = "seconds flown over airspeed [m/s]";
  speeds(box.children[live.map.planes.length].lastChild, live.map);
}
function learning(live) { maneuver(live); causes(live); suggested(live); maps(live); }
