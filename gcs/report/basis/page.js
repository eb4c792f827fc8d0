"use strict";
// Draws the figures one after the other, those in sight first, in the colours of the page; keeps their time
// axes together; plays the flight in the 3-D picture. Before printing everything is drawn, in the colours of paper
// and as wide as it: the page is laid out for paper only afterwards, and a figure as wide as the screen is cut there.
const plots = [...document.querySelectorAll(".plot")];
const drawn = new Set();
const dark = window.matchMedia("(prefers-color-scheme: dark)");
const config = { responsive: true, displaylogo: false, modeBarButtonsToRemove: ["lasso2d", "select2d"] };
const PAPER = 680, TALL = 920, FLAT = 0.7; // px: A4 inside the margins of page.css; a narrower figure is less high
let printing = false;
let following = false; // a figure is being moved by another one

function colours(layout) {
  const night = dark.matches && !printing;
  const ink = night ? "#e8eaf0" : "#1a1d24", grid = night ? "#3a404c" : "#d5d9e0";
  const change = { "font.color": ink };
  for (const name of Object.keys(layout)) {
    if (/^[xy]axis\d*$/.test(name)) for (const part of ["grid", "zeroline", "line"]) change[`${name}.${part}color`] = grid;
    if (name === "scene") for (const axis of ["xaxis", "yaxis", "zaxis"]) change[`scene.${axis}.gridcolor`] = grid;
  }
  return change;
}

function paint(layout) {
  for (const [path, value] of Object.entries(colours(layout))) {
    const names = path.split("."), last = names.pop();
    names.reduce((node, name) => (node[name] ??= {}), layout)[last] = value;
  }
}

function draw(plot) {
  if (drawn.has(plot)) return;
  drawn.add(plot);
  const figure = JSON.parse(document.getElementById(plot.dataset.figure).textContent);
  const meta = figure.layout.meta || {};
  paint(figure.layout);
  Plotly.newPlot(plot, figure.data, figure.layout, config);
  if (meta.time) plot.on("plotly_relayout", (event) => follow(plot, event));
  if (meta.replay) replay(plot, meta.replay);
}

function follow(source, event) {
  if (following) return;
  const from = event["xaxis.range[0]"], to = event["xaxis.range[1]"];
  if (from === undefined && !event["xaxis.autorange"]) return;
  following = true;
  const change = from === undefined ? { "xaxis.autorange": true } : { "xaxis.range": [from, to] };
  for (const plot of drawn) if (plot !== source && (plot.layout.meta || {}).time) Plotly.relayout(plot, change);
  following = false;
}

function replay(plot, about) {
  const bar = document.createElement("div"), button = document.createElement("button");
  const slider = document.createElement("input"), told = document.createElement("output"), speed = document.createElement("select");
  bar.className = "replay";
  button.textContent = "Play";
  Object.assign(slider, { type: "range", min: 0, max: about.t.length - 1, value: about.t.length - 1 });
  slider.setAttribute("aria-label", "time");
  speed.setAttribute("aria-label", "speed");
  for (const factor of [1, 5, 20, 60]) speed.add(new Option(`${factor}×`, factor, factor === 20, factor === 20));
  bar.append(button, slider, told, speed);
  plot.before(bar);
  let timer = 0, clock = about.t[0];
  const show = (k) => {
    slider.value = k;
    told.textContent = `${about.t[k].toFixed(1)} s`;
    Plotly.restyle(plot, { x: [[about.x[k]]], y: [[about.y[k]]], z: [[about.z[k]]] }, [about.trace]);
  };
  const stop = () => { clearInterval(timer); timer = 0; button.textContent = "Play"; };
  button.onclick = () => {
    if (timer) return stop();
    button.textContent = "Pause";
    if (Number(slider.value) >= about.t.length - 1) slider.value = 0;
    clock = about.t[slider.value];
    timer = setInterval(() => {
      clock += 0.1 * Number(speed.value);
      let k = Number(slider.value);
      while (k < about.t.length - 1 && about.t[k] < clock) k++;
      show(k);
      if (k === about.t.length - 1) stop();
    }, 100);
  };
  slider.oninput = () => { clock = about.t[slider.value]; show(Number(slider.value)); };
  show(about.t.length - 1);
}

const watcher = new IntersectionObserver((seen) => seen.filter((one) => one.isIntersecting).forEach((one) => draw(one.target)), { rootMargin: "600px" });
plots.forEach((plot) => watcher.observe(plot));
function rest() {
  const next = plots.find((plot) => !drawn.has(plot));
  if (next) { draw(next); setTimeout(rest, 30); } else document.body.dataset.drawn = "all";
}
window.addEventListener("load", () => setTimeout(rest, 300));
function repaint() { for (const plot of drawn) Plotly.relayout(plot, colours(plot.layout)); }
function fit(plot) {
  const screen = Number(plot.dataset.height);
  const height = printing ? Math.min(FLAT * screen, TALL) : screen;
  Object.assign(plot.style, { width: printing ? `${PAPER}px` : "", height: `${height}px` });
  Plotly.relayout(plot, printing ? { width: PAPER, height } : { width: null, height: null, autosize: true });
}
function print(now) { printing = now; plots.forEach(draw); repaint(); plots.forEach(fit); }
dark.addEventListener("change", repaint);
window.addEventListener("beforeprint", () => print(true));
window.addEventListener("afterprint", () => print(false));
