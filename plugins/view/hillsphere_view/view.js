"use strict";
// The pages of runs: forms that send, lists that follow what is typed, progress, and plots.

/** Replace an element by its counterpart on a page of this server; return the new one. */
async function refresh(selector, address) {
  const answer = await fetch(address, { headers: { accept: "text/html" } });
  if (!answer.ok) return null;
  const made = new DOMParser().parseFromString(await answer.text(), "text/html").querySelector(selector);
  if (made) document.querySelector(selector)?.replaceWith(made);
  return made;
}

/** Send a form; a form of the browser's own would not say which page it comes from. */
for (const form of document.querySelectorAll("form[data-post]")) {
  form.addEventListener("submit", async (event) => {
    event.preventDefault();
    const button = form.querySelector("button");
    const told = form.querySelector(".problems") ?? document.getElementById("told");
    button.disabled = true;
    told.textContent = "";
    try {
      const answer = await fetch(form.action, { method: "POST", body: new URLSearchParams(new FormData(form)) });
      const said = await answer.json();
      if (answer.ok) return location.assign(said.to);
      told.textContent = said.problems.join("\n");
    } catch {
      told.textContent = "The server does not answer. Has it ended?";
    }
    button.disabled = false;
  });
}

/** Follow what is typed into the filter of a list. */
for (const form of document.querySelectorAll("form[data-live]")) {
  let timer = 0;
  const update = async () => {
    const address = `${location.pathname}?${new URLSearchParams(new FormData(form))}`;
    const chosen = new Set(chosenRuns());
    if (!(await refresh(form.dataset.live, address))) return;
    history.replaceState(null, "", address);
    for (const box of document.querySelectorAll("input[name=run]")) box.checked = chosen.has(box.value);
    countChosen();
  };
  form.addEventListener("input", () => {
    clearTimeout(timer);
    timer = setTimeout(update, 250);
  });
  form.addEventListener("submit", (event) => {
    event.preventDefault();
    update();
  });
}

/** Let two to six runs be compared. */
const chosenRuns = () => [...document.querySelectorAll("input[name=run]:checked")].map((box) => box.value);
function countChosen() {
  const button = document.getElementById("compare");
  if (!button) return;
  const count = chosenRuns().length;
  button.disabled = count < 2 || count > Number(button.dataset.most);
  button.textContent = count < 2 ? "Compare (choose 2 runs or more)" : `Compare ${count} runs`;
}
document.addEventListener("change", (event) => event.target.name === "run" && countChosen());
countChosen();

/** Show the progress of a run; once it has ended, the whole page is new. */
async function follow() {
  if (!document.querySelector("#live[data-running]")) return;
  let live = null;
  try {
    live = await refresh("#live", location.href);
  } catch {
    document.getElementById("told").textContent = "The server does not answer. The run goes on.";
  }
  if (live && !("running" in live.dataset)) return location.reload();
  setTimeout(follow, 1000);
}
setTimeout(follow, 1000);

// --- plots

const isDark = window.matchMedia("(prefers-color-scheme: dark)");

let library = null;
function loadPlotly() {
  library ??= new Promise((done, fail) => {
    const script = document.createElement("script");
    script.src = "/static/plotly.js";
    script.onload = () => done(window.Plotly);
    script.onerror = fail;
    document.head.append(script);
  });
  return library;
}

/** Return a layout with the colours of the page. */
function themed(layout) {
  const css = getComputedStyle(document.documentElement);
  const [ink, soft, grid, accent] = ["--ink", "--soft", "--grid", "--accent"].map((name) => css.getPropertyValue(name).trim());
  const axis = { gridcolor: grid, linecolor: soft, zeroline: false, showline: true, ticks: "outside", tickcolor: soft };
  const clear = "rgba(0,0,0,0)";
  const made = { ...layout, font: { color: ink, size: 12, family: "system-ui, sans-serif" }, paper_bgcolor: clear, plot_bgcolor: clear };
  made.modebar = { bgcolor: clear, color: soft, activecolor: accent };
  for (const [key, value] of Object.entries(made)) {
    if (/^[xy]axis\d*$/.test(key)) made[key] = { ...axis, ...value };
    if (/^scene\d*$/.test(key)) {
      for (const name of ["xaxis", "yaxis", "zaxis"]) {
        value[name] = { gridcolor: grid, zerolinecolor: grid, showbackground: false, color: soft, ...value[name] };
      }
    }
    if (/^polar\d*$/.test(key)) value.bgcolor = clear;
  }
  return made;
}

async function draw(box) {
  try {
    const answer = await fetch(box.dataset.src);
    const text = await answer.text();
    if (!answer.ok) throw new Error(`status ${answer.status}`);
    const figure = JSON.parse(isDark.matches ? text.replaceAll('"#000000"', '"#e4e8ec"') : text);
    const plotly = await loadPlotly();
    box.style.height = `${figure.height}px`;
    const options = { responsive: true, displaylogo: false, modeBarButtonsToRemove: ["lasso2d", "select2d"] };
    await plotly.newPlot(box, figure.data, themed(figure.layout), options);
    box.dataset.drawn = "yes";
  } catch (error) {
    box.dataset.drawn = "no";
    box.style.height = "auto";
    box.textContent = `This figure cannot be drawn (${error.message}).`;
  }
}

const seen = new IntersectionObserver((entries) => {
  for (const entry of entries) {
    if (!entry.isIntersecting) continue;
    seen.unobserve(entry.target);
    draw(entry.target);
  }
}, { rootMargin: "300px" });
const plots = [...document.querySelectorAll(".plot")];
plots.forEach((box) => seen.observe(box));
isDark.addEventListener("change", () => plots.filter((box) => box.dataset.drawn === "yes").forEach(draw));
