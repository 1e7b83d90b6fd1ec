"use strict";

/* Draws the report's charts in the colours of the page's theme, and moves the cuts through the maps. */

const DATA = JSON.parse(document.getElementById("data").textContent);
const SETTINGS = { responsive: true, displayModeBar: false, scrollZoom: false, plotlyServerURL: "", showSendToCloud: false };
const PAPER_WIDTH = 660; // px that fit between the margins of A4
const PAPER_HEIGHTS = [370, 840]; // two on a page below a heading, or one

/* --- arrays ------------------------------------------------------------------------------------------------------- */

function unpack(packed) {
  const text = atob(packed.bdata);
  const bytes = Uint8Array.from(text, (letter) => letter.charCodeAt(0));
  return packed.dtype === "u1" ? bytes : new Float32Array(bytes.buffer);
}

function rows(packed) {
  const values = unpack(packed);
  const [height, width] = packed.shape.split(",").map(Number);
  return Array.from({ length: height }, (_, k) => Array.from(values.subarray(k * width, (k + 1) * width)));
}

/* --- themes ------------------------------------------------------------------------------------------------------- */

let printing = false;

/* The colours of the theme that shows. */
function inks() {
  const style = getComputedStyle(document.documentElement);
  const ink = (name) => style.getPropertyValue("--" + name).trim();
  return { "@ink": ink("ink"), "@muted": ink("muted"), "@grid": ink("grid"), "@ground": ink("ground"), "@empty": ink("empty") };
}

function painted(value, colours) {
  if (typeof value === "string") { return Object.hasOwn(colours, value) ? colours[value] : value; }
  if (Array.isArray(value)) { return value.map((each) => painted(each, colours)); }
  if (value === null || typeof value !== "object" || ArrayBuffer.isView(value)) { return value; }
  if (value.bdata) { return value.shape ? rows(value) : unpack(value); }
  const copy = {};
  for (const [key, each] of Object.entries(value)) {
    if (key === "codes") {
      copy.text = rows(each.cells).map((row) => row.map((code) => each.names[code]));
    } else {
      copy[key] = painted(each, colours);
    }
  }
  return copy;
}

function figure(spec, height) {
  const { data, layout } = painted(spec, inks());
  return { data, layout: { ...layout, height } };
}

function draw(name, spec) {
  const place = document.getElementById(name);
  const height = parseInt(place.style.height, 10);
  if (printing) {
    const { data, layout } = figure(spec, Math.min(height, PAPER_HEIGHTS[height > 600 ? 1 : 0]));
    return Plotly.newPlot(place, data, { ...layout, width: PAPER_WIDTH }, SETTINGS);
  }
  const { data, layout } = figure(spec, height);
  return Plotly.react(place, data, { ...layout, autosize: true }, SETTINGS);
}

/* --- cuts --------------------------------------------------------------------------------------------------------- */

const LINES = ["#0072B2", "#D55E00", "#009E73", "#CC79A7"];
const DASHES = ["solid", "dash", "dot", "dashdot"];

function readMap(packed) {
  const tables = {};
  for (const [name, table] of Object.entries(packed.tables)) { tables[name] = rows(table); }
  const binding = packed.binding && { codes: rows(packed.binding.codes), names: packed.binding.names };
  return { name: packed.name, speed: unpack(packed.speed_km_h), angle: unpack(packed.front_angle_deg), tables, binding };
}

/* Where a value lies between breakpoints: index of the lower one, and the share of the way; null outside. */
function locate(axis, value) {
  const slack = 1e-4 * Math.max(1, Math.abs(value));
  if (!(value >= axis[0] - slack && value <= axis[axis.length - 1] + slack)) { return null; }
  let low = 0;
  while (low < axis.length - 2 && axis[low + 1] <= value) { low += 1; }
  const share = (value - axis[low]) / (axis[low + 1] - axis[low]);
  return [low, Math.min(Math.max(share, 0), 1)];
}

/* Linear between two values; on a breakpoint the other value is ignored, feasible or not. */
function between(first, second, share) {
  if (share < 1e-4) { return first; }
  if (share > 1 - 1e-4) { return second; }
  return first + share * (second - first);
}

function valueAt(map, table, speed, angle) {
  const row = locate(map.speed, speed);
  const column = locate(map.angle, angle);
  if (!row || !column) { return NaN; }
  const [i, u] = row;
  const [j, w] = column;
  return between(between(table[i][j], table[i][j + 1], w), between(table[i + 1][j], table[i + 1][j + 1], w), u);
}

function bindingAt(map, speed, angle) {
  if (!map.binding || !Number.isFinite(valueAt(map, map.tables.yaw_rate, speed, angle))) { return "-"; }
  const near = (at) => at[0] + Math.round(at[1]);
  const code = map.binding.codes[near(locate(map.speed, speed))][near(locate(map.angle, angle))];
  return map.binding.names[code] ?? "-";
}

function cutFigure(maps, overSpeed, speed, angle) {
  const shown = DATA.cuts.quantities.filter(({ table }) => maps.some((map) => map.tables[table]));
  const data = [];
  const layout = {
    paper_bgcolor: "rgba(0,0,0,0)", plot_bgcolor: "rgba(0,0,0,0)",
    font: { color: "@ink", size: 13, family: "system-ui, 'Segoe UI', 'Noto Sans', 'DejaVu Sans', sans-serif" },
    hoverlabel: { bgcolor: "@ground", bordercolor: "@muted", font: { color: "@ink" } },
    margin: { l: 70, r: 20, t: 30, b: 50 }, hovermode: "x",
    legend: { orientation: "h", yanchor: "bottom", y: 1.01, x: 0 },
    shapes: [{
      type: "line", xref: "x", yref: "paper", y0: 0, y1: 1,
      x0: overSpeed ? speed : angle, x1: overSpeed ? speed : angle, line: { color: "@muted", width: 1, dash: "dot" },
    }],
  };
  const look = { gridcolor: "@grid", linecolor: "@muted", zerolinecolor: "@muted", ticks: "outside", ticklen: 4, tickcolor: "@muted" };
  const axis = maps[0][overSpeed ? "speed" : "angle"];
  layout.xaxis = {
    ...look, title: { text: DATA.cuts.axes[overSpeed ? 0 : 1] }, anchor: shown.length > 1 ? "y" + shown.length : "y",
    range: [axis[0], axis[axis.length - 1]],
  };
  const height = (1 - 0.06 * (shown.length - 1)) / shown.length;
  shown.forEach(({ table, name, unit }, panel) => {
    const top = 1 - panel * (height + 0.06);
    layout["yaxis" + (panel ? panel + 1 : "")] = {
      ...look, title: { text: name + "<br>(" + unit + ")" }, domain: [Math.max(0, top - height), top],
      rangemode: panel ? "normal" : "tozero", automargin: true,
    };
    maps.forEach((map, k) => {
      if (!map.tables[table]) { return; }
      const own = Array.from(map[overSpeed ? "speed" : "angle"]);
      const values = own.map((at) => valueAt(map, map.tables[table], overSpeed ? at : speed, overSpeed ? angle : at));
      data.push({
        type: "scatter", mode: "lines", x: own, y: values, name: map.name, legendgroup: map.name, showlegend: panel === 0,
        yaxis: "y" + (panel ? panel + 1 : ""), line: { color: LINES[k % LINES.length], dash: DASHES[k % DASHES.length], width: 2 },
        hovertemplate: map.name + ": %{y:.3f} " + unit + "<extra></extra>",
      });
    });
  });
  return { data, layout };
}

function text(tag, content, settings) {
  const element = document.createElement(tag);
  element.textContent = content;
  return Object.assign(element, settings);
}

function showValues(maps, speed, angle) {
  const table = document.getElementById("cut-values");
  const head = document.createElement("tr");
  const names = DATA.cuts.quantities.map(({ name }) => name);
  for (const title of ["at this point", ...names, "binds"]) { head.append(text("th", title, { scope: "col" })); }
  const body = maps.map((map) => {
    const row = document.createElement("tr");
    row.append(text("th", map.name, { scope: "row" }));
    for (const { table, unit } of DATA.cuts.quantities) {
      const values = map.tables[table];
      const value = values ? valueAt(map, values, speed, angle) : NaN;
      row.append(text("td", Number.isFinite(value) ? value.toFixed(3) + " " + unit : values ? "infeasible" : "-"));
    }
    row.append(text("td", bindingAt(map, speed, angle)));
    return row;
  });
  table.replaceChildren(head, ...body);
}

function cuts() {
  if (!DATA.cuts) { return () => undefined; }
  const maps = DATA.cuts.maps.map(readMap);
  const [first] = maps;
  const sliders = ["speed", "angle"].map((name) => document.getElementById("cut-" + name));
  const nearest = (axis, value) => axis.reduce((best, each, k) => (Math.abs(each - value) < Math.abs(axis[best] - value) ? k : best), 0);
  [[first.speed, 43.9], [first.angle, 4]].forEach(([axis, start], k) => {
    sliders[k].max = axis.length - 1;
    sliders[k].value = nearest(axis, start);
  });
  const show = () => {
    const speed = first.speed[Number(sliders[0].value)];
    const angle = first.angle[Number(sliders[1].value)];
    const parts = [speed.toFixed(1) + " km/h", angle.toFixed(2) + " deg"];
    parts.forEach((value, k) => {
      document.getElementById(sliders[k].id + "-value").textContent = value;
      sliders[k].setAttribute("aria-valuetext", value);
    });
    showValues(maps, speed, angle);
    draw("cut-over-speed", cutFigure(maps, true, speed, angle));
    draw("cut-over-angle", cutFigure(maps, false, speed, angle));
  };
  let waiting = false;
  const soon = () => {
    if (waiting) { return; }
    waiting = true;
    requestAnimationFrame(() => { waiting = false; show(); });
  };
  sliders.forEach((slider) => slider.addEventListener("input", soon));
  return show;
}

/* --- the page ----------------------------------------------------------------------------------------------------- */

const showCuts = cuts();
const sections = [...document.querySelectorAll("main details")];

/* A folded section has no width to draw in: its charts are drawn when it is unfolded, and again after a change of theme. */
async function drawSection(section) {
  if (section.querySelector("#cut-values")) { showCuts(); }
  const specs = [...section.querySelectorAll(".chart")].map((place) => [place.id, DATA.charts[place.id.replace(/^chart-/, "")]]);
  await Promise.all(specs.filter(([, spec]) => spec).map(([name, spec]) => draw(name, spec)));
  section.dataset.drawn = "yes";
}

async function drawAll() {
  for (const section of sections) {
    if (section.open) { await drawSection(section); } else { delete section.dataset.drawn; }
  }
  document.documentElement.dataset.drawn = "yes";
}

for (const section of sections) {
  section.addEventListener("toggle", () => { if (section.open && !section.dataset.drawn) { drawSection(section); } });
}

/* A link to a section unfolds it. */
function unfoldTarget() {
  const target = location.hash && document.getElementById(location.hash.slice(1));
  const section = target && target.querySelector("details");
  if (section) { section.open = true; target.scrollIntoView(); }
}
addEventListener("hashchange", unfoldTarget);

document.getElementById("unfold").addEventListener("click", (event) => {
  const folded = sections.some((section) => !section.open);
  for (const section of sections) { section.open = folded || section === sections[0]; }
  event.target.textContent = folded ? "Fold all" : "Unfold all";
});

function isDark() {
  const chosen = document.documentElement.dataset.theme;
  return chosen ? chosen === "dark" : matchMedia("(prefers-color-scheme: dark)").matches;
}

document.getElementById("theme").addEventListener("click", () => {
  document.documentElement.dataset.theme = isDark() ? "light" : "dark";
  drawAll();
});
matchMedia("(prefers-color-scheme: dark)").addEventListener("change", drawAll);

let folded = [];
function turn(toPaper) {
  if (toPaper === printing) { return; }
  printing = toPaper;
  if (printing) {
    folded = sections.filter((section) => !section.open);
    for (const section of folded) { section.open = true; }
  }
  // At once: what is drawn later does not come onto the paper.
  for (const section of sections) { drawSection(section); }
  if (!printing) { for (const section of folded) { section.open = false; delete section.dataset.drawn; } }
}
addEventListener("beforeprint", () => turn(true));
addEventListener("afterprint", () => turn(false));
matchMedia("print").addEventListener("change", (event) => turn(event.matches));

drawAll().then(unfoldTarget);
