"use strict";
// The page of a run: plots, tables that sort, search. It works from a file, without any request.

const isDark = window.matchMedia("(prefers-color-scheme: dark)");
const NARROW_PX = 620; // below this width the panels of a figure stand below one another
const FAINT = 0.12; // relative luminance below which a thin line is lost on a dark page
const PAPER = ["#000000", "#444444", "#dddddd"]; // ink, axes and grid in print
const PAPER_PX = 760; // width of a printed figure: a little more than paper has, for letters of 8 points
const MOST_VECTOR = 300_000; // characters of a plot's data beyond which its SVG would be slow

/** Return plotly.js, unpacked and run at the first call; null where the browser cannot. */
let plotly = null;
function loadPlotly() {
  plotly ??= (async () => {
    const block = document.getElementById("plotly");
    if (!block || !window.DecompressionStream) return null;
    const packed = Uint8Array.from(atob(block.textContent), (c) => c.charCodeAt(0));
    const stream = new Blob([packed]).stream().pipeThrough(new DecompressionStream("deflate"));
    const script = document.createElement("script");
    script.textContent = await new Response(stream).text();
    document.head.append(script);
    return window.Plotly ?? null;
  })();
  return plotly;
}

/** Return the colours of ink, axes and grid on the page. */
function pageColours() {
  const css = getComputedStyle(document.documentElement);
  return ["--ink", "--soft", "--grid"].map((n) => css.getPropertyValue(n).trim());
}

/** Return a copy of a layout with such colours. */
function themed(layout, [ink, soft, grid]) {
  const made = structuredClone(layout);
  made.font = { color: ink, size: 12, family: "system-ui, sans-serif" };
  made.paper_bgcolor = made.plot_bgcolor = "rgba(0,0,0,0)";
  made.modebar = { bgcolor: "rgba(0,0,0,0)", color: soft, activecolor: ink };
  const axis = { gridcolor: grid, linecolor: soft, zeroline: false, showline: true, ticks: "outside", tickcolor: soft };
  for (const [key, value] of Object.entries(made)) {
    if (/^[xy]axis\d*$/.test(key)) made[key] = { ...axis, ...value };
    if (/^scene\d*$/.test(key)) {
      for (const name of ["xaxis", "yaxis", "zaxis"]) {
        value[name] = { gridcolor: grid, zerolinecolor: grid, showbackground: false, color: soft, ...value[name] };
      }
    }
    if (/^polar\d*$/.test(key)) {
      value.bgcolor = "rgba(0,0,0,0)";
      for (const name of ["angularaxis", "radialaxis"]) Object.assign(value[name], { gridcolor: grid, linecolor: soft });
    }
  }
  return made;
}

/** Return the data of a plot. */
const textOf = (box) => document.getElementById(`plot-${box.dataset.plot}`).textContent;

/** Return a dark colour of a line or marker lightened, by half if it is nearly black. */
function lightened(key, hex) {
  const parts = [0, 2, 4].map((i) => parseInt(hex.slice(i, i + 2), 16));
  const luminance = [0.2126, 0.7152, 0.0722].reduce((sum, w, i) => sum + w * (parts[i] / 255) ** 2.2, 0);
  const share = 0.5 * Math.max(1 - luminance / FAINT, 0);
  return `"color":"#${parts.map((c) => Math.round(c + share * (255 - c)).toString(16).padStart(2, "0")).join("")}"`;
}

/** Return a figure on the page: a dark one would swallow black and dark colours. */
function figureOf(box) {
  const text = textOf(box);
  if (!isDark.matches) return JSON.parse(text);
  return JSON.parse(text.replaceAll('"#000000"', '"#e4e8ec"').replace(/"color":"#([0-9a-f]{6})"/gi, lightened));
}

async function draw(box) {
  const library = await loadPlotly();
  if (!library) return showPictures();
  const given = figureOf(box);
  const isNarrow = box.clientWidth < NARROW_PX && given.narrow;
  if (isNarrow) {
    for (const [key, part] of Object.entries(given.narrow.layout)) Object.assign(given.layout[key], part);
    for (const [i, part] of Object.entries(given.narrow.annotations)) Object.assign(given.layout.annotations[i], part);
  }
  const height = isNarrow ? given.narrow.height : given.height;
  box.style.height = `${height}px`;
  const options = { responsive: true, displaylogo: false, modeBarButtonsToRemove: ["lasso2d", "select2d"] };
  // A telephone shows the buttons always, and has no room for them; two taps restore a view.
  if (box.clientWidth < NARROW_PX) options.displayModeBar = false;
  try {
    await library.newPlot(box, given.data, themed(given.layout, pageColours()), options);
  } catch {
    return showPictures();
  }
  box.dataset.drawn = "yes";
  if (!box.closest("details")) preparePrint([box]);
  linkRows(box, given.data);
  addSlider(box, given);
}

/** Draw pictures of plots without one, in idle time: printing does not wait for plotly.js. */
let pictures = Promise.resolve();
function preparePrint(boxes) {
  for (const box of boxes) {
    if (box.parentElement.querySelector(".picture") || box.dataset.printed) continue;
    box.dataset.printed = "yes";
    const idle = () => new Promise((go) => (window.requestIdleCallback ?? setTimeout)(go));
    pictures = pictures.then(idle).then(() => addPicture(box)).catch(() => {});
  }
}

async function addPicture(box) {
  const library = await loadPlotly();
  if (!library) return;
  const text = textOf(box);
  const given = JSON.parse(text);
  const figure = { data: given.data, layout: themed(given.layout, PAPER) };
  const format = text.length > MOST_VECTOR ? "png" : "svg";
  const src = await library.toImage(figure, { format, width: PAPER_PX, height: given.height });
  box.after(Object.assign(new Image(), { className: "picture", alt: box.getAttribute("aria-label"), src }));
}

function showPictures() {
  document.body.classList.add("no-plots");
}

/** Mark the row of the table that the point under the pointer stands for. */
function linkRows(box, traces) {
  const table = document.getElementById(box.dataset.table ?? "");
  if (!table) return;
  const rows = [...table.querySelectorAll("tr[data-row]")];
  const mark = (row) => rows.forEach((r) => r.classList.toggle("linked", Number(r.dataset.row) === row));
  box.on("plotly_hover", ({ points: [point] }) => {
    const given = traces[point.curveNumber]?.meta?.rows;
    mark(typeof given === "number" ? given : given?.[point.pointNumber]);
  });
  box.on("plotly_unhover", () => mark(-1));
}

/** Add a slider of time to a scene whose paths have times; a marker moves along each path. */
function addSlider(box, figure) {
  const moving = figure.data.filter((trace) => trace.meta?.times);
  if (!moving.length) return;
  const times = moving.map((trace) => trace.meta.times);
  const [low, high] = [Math.min(...times.map((t) => t[0])), Math.max(...times.map((t) => t.at(-1)))];
  const paths = box.data.filter((trace) => trace.meta?.times);
  const at = (time) => moving.map((_, i) => {
    const last = times[i].findLastIndex((t) => t <= time);
    return Math.max(last, 0);
  });
  const place = (time, axis) => at(time).map((k, i) => box._fullData[box.data.indexOf(paths[i])][axis][k]);
  const first = box.data.length;
  const marks = () => ({ x: place(input.value, "x"), y: place(input.value, "y"), z: place(input.value, "z") });
  const label = document.createElement("label");
  label.className = "slider";
  const input = Object.assign(document.createElement("input"), { type: "range", min: low, max: high, step: "any", value: low });
  const shown = document.createElement("output");
  const name = figure.layout.meta?.time ?? "time";
  label.append(name, input, shown);
  box.after(label);
  const text = () => (shown.textContent = Number(input.value).toPrecision(4));
  text();
  window.Plotly.addTraces(box, {
    type: "scatter3d", mode: "markers", showlegend: false, scene: moving[0].scene, ...marks(),
    marker: { size: 6, color: paths.map((trace) => trace.line.color) },
  });
  input.addEventListener("input", () => {
    text();
    const { x, y, z } = marks();
    window.Plotly.restyle(box, { x: [x], y: [y], z: [z] }, [first]);
  });
}

/** Draw each plot when it comes into view, so that a long page opens at once. */
const seen = new IntersectionObserver((entries) => {
  for (const entry of entries) {
    if (!entry.isIntersecting) continue;
    seen.unobserve(entry.target);
    draw(entry.target);
  }
}, { rootMargin: "300px" });
const plots = [...document.querySelectorAll(".plot")];
plots.forEach((box) => seen.observe(box));
isDark.addEventListener("change", () => plots.filter((box) => box.dataset.drawn).forEach((box) => {
  box.parentElement.querySelector(".slider")?.remove();
  draw(box);
}));

/** Return the value of a cell for sorting: its exact number, its text, or null for a blank. */
function keyOf(row, index) {
  const cell = row.cells[index];
  const text = (cell.dataset.v ?? cell.textContent).trim().replace("−", "-").replace("inf", "Infinity");
  if (["", "–", "nan"].includes(text)) return null;
  return Number.isNaN(Number(text)) ? text : Number(text);
}

function sortBy(heading) {
  const body = heading.closest("table").tBodies[0];
  const down = heading.getAttribute("aria-sort") === "ascending";
  const sign = down ? -1 : 1;
  const sorted = [...body.rows].sort((a, b) => {
    const [p, q] = [keyOf(a, heading.cellIndex), keyOf(b, heading.cellIndex)];
    if (p === null || q === null) return (p === null) - (q === null); // blanks last
    const isNumber = typeof p === "number" && typeof q === "number";
    return sign * (isNumber ? p - q : String(p).localeCompare(String(q)));
  });
  body.append(...sorted);
  for (const other of heading.parentElement.cells) other.removeAttribute("aria-sort");
  heading.setAttribute("aria-sort", down ? "descending" : "ascending");
}

for (const heading of document.querySelectorAll(".table thead th")) {
  heading.classList.add("sortable");
  heading.tabIndex = 0;
  heading.title = "sort";
  heading.addEventListener("click", () => sortBy(heading));
  heading.addEventListener("keydown", (event) => {
    if (event.key !== "Enter" && event.key !== " ") return;
    event.preventDefault();
    sortBy(heading);
  });
}

/** Return a table as CSV, as its file has it: every column, and the exact numbers. */
function csvOf(table) {
  const quote = (text) => (/[",\n]/.test(text) ? `"${text.replaceAll('"', '""')}"` : text);
  const text = (cell) => quote(cell.dataset.v ?? cell.textContent.replace(/\s+/g, " ").trim());
  const lines = [...table.rows].map((row) => [...row.cells].map(text));
  const isTurned = table.classList.contains("transposed");
  const rows = isTurned ? lines[0].map((_, i) => lines.map((line) => line[i])) : lines;
  return rows.map((row) => row.join(",")).join("\n");
}

for (const figure of document.querySelectorAll(".table")) {
  const [all, copy] = [figure.querySelector(".all"), figure.querySelector(".copy")];
  if (all) {
    all.hidden = false;
    const closed = all.textContent;
    all.addEventListener("click", () => {
      all.textContent = figure.classList.toggle("whole") ? "fewer columns" : closed;
    });
  }
  copy.hidden = false;
  const offer = copy.textContent;
  copy.addEventListener("click", async () => {
    const text = csvOf(figure.querySelector("table"));
    try {
      await navigator.clipboard.writeText(text);
    } catch {
      const area = Object.assign(document.createElement("textarea"), { value: text });
      document.body.append(area);
      area.select();
      document.execCommand("copy");
      area.remove();
    }
    copy.textContent = offer.replace("copy", "copied");
    setTimeout(() => (copy.textContent = offer), 1500);
  });
}

/** Open the sections that hold a text, and hide the others. */
const search = document.getElementById("search");
const folds = [...document.querySelectorAll("main > details")];
search.hidden = false;
for (const fold of folds) {
  fold.addEventListener("toggle", () => fold.open && preparePrint(fold.querySelectorAll(".plot")));
}
search.addEventListener("input", () => {
  const wanted = search.value.trim().toLowerCase();
  for (const fold of folds) {
    const has = fold.textContent.toLowerCase().includes(wanted);
    fold.hidden = Boolean(wanted) && !has;
    if (wanted.length > 2 && has) fold.open = true;
  }
});

/** Open the fold that a link leads into. */
function openTarget() {
  const target = document.getElementById(decodeURIComponent(location.hash.slice(1)));
  const fold = target?.closest("details");
  if (fold) fold.open = true;
  if (target) target.scrollIntoView();
}
window.addEventListener("hashchange", openTarget);
openTarget();

/** Fold the contents on a narrow page, where they would stand before the answer. */
const contents = document.querySelector("nav details");
const isWide = window.matchMedia("(min-width: 56.01rem)");
const foldContents = () => (contents.open = isWide.matches);
isWide.addEventListener("change", foldContents);
contents.addEventListener("click", (event) => event.target.closest("a") && foldContents());
foldContents();

/** Mark the entry of the contents whose section is in view. */
const links = new Map([...document.querySelectorAll("nav a")].map((a) => [a.hash.slice(1), a]));
const place = new IntersectionObserver((entries) => {
  for (const entry of entries) {
    if (!entry.isIntersecting) continue;
    for (const [id, link] of links) link.classList.toggle("here", id === entry.target.id);
  }
}, { rootMargin: "0px 0px -70% 0px" });
for (const id of links.keys()) place.observe(document.getElementById(id));
