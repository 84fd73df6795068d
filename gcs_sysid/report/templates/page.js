(() => {
  "use strict";
  const { figures, palettes } = JSON.parse(document.getElementById("payload").textContent);
  const dark = window.matchMedia("(prefers-color-scheme: dark)");
  const PRINTED = { wide: 680, small: 325, tallest: 940 };
  let printing = false;

  // "@{role/opacity}" stands for a colour of the palette in use.
  const painted = (text, palette) => text.replace(/@\{(\w+)\/([\d.]+)\}/g, (whole, role, opacity) => {
    const colour = palette[role];
    if (!colour) return whole;
    const [r, g, b] = [1, 3, 5].map((at) => parseInt(colour.slice(at, at + 2), 16));
    return `rgba(${r},${g},${b},${opacity})`;
  });
  const paint = (node, palette) => {
    if (typeof node === "string") return painted(node, palette);
    if (Array.isArray(node)) return node.map((item) => paint(item, palette));
    if (node && typeof node === "object") {
      if (node.bdata !== undefined) return node;
      return Object.fromEntries(Object.entries(node).map(([key, item]) => [key, paint(item, palette)]));
    }
    return node;
  };

  const config = {
    displayModeBar: window.matchMedia("(hover: hover)").matches ? "hover" : false,
    responsive: true, displaylogo: false, scrollZoom: false,
    modeBarButtonsToRemove: ["select2d", "lasso2d", "autoScale2d", "zoomIn2d", "zoomOut2d"],
  };
  const ranges = {};
  const draw = (canvas) => {
    const figure = figures[canvas.dataset.figure];
    const palette = palettes[!printing && dark.matches ? "dark" : "light"];
    const layout = paint(figure.layout, palette);
    // On a touch screen a finger on a plot scrolls the page.
    layout.dragmode = window.matchMedia("(pointer: coarse)").matches ? false : "zoom";
    const width = printing ? PRINTED[figure.size] : canvas.clientWidth;
    if (printing) Object.assign(layout, { width, height: Math.min(layout.height, PRINTED.tallest) });
    layout.xaxis.nticks = Math.max(5, Math.round(width / 70));
    if (ranges[figure.link]) layout.xaxis.range = ranges[figure.link].slice();
    Plotly.react(canvas, paint(figure.data, palette), layout, config);
    if (!canvas.dataset.drawn) {
      canvas.dataset.drawn = "yes";
      if (figure.link) canvas.on("plotly_relayout", (change) => follow(figure.link, canvas, change));
    }
  };

  const linked = (link) => [...document.querySelectorAll("[data-drawn]")]
    .filter((canvas) => figures[canvas.dataset.figure].link === link);
  const show = (link, range, except) => {
    ranges[link] = range;
    for (const canvas of linked(link)) {
      if (canvas !== except) Plotly.relayout(canvas, { "xaxis.range": range.slice() });
    }
  };
  const follow = (link, canvas, change) => {
    const named = Object.keys(change).some((key) => key.startsWith("xaxis."));
    if (!named) return;
    const range = canvas.layout.xaxis.range.map(Number);
    const before = ranges[link];
    if (before && before[0] === range[0] && before[1] === range[1]) return;
    show(link, range, canvas);
  };

  const open = (canvas) => !canvas.closest("details:not([open])");
  const canvases = [...document.querySelectorAll("[data-figure]")];
  const queue = canvases.filter(open);
  const next = () => {
    const canvas = queue.shift();
    if (!canvas) return;
    if (!canvas.dataset.drawn) draw(canvas);
    setTimeout(next);
  };
  next();

  for (const details of document.querySelectorAll("details")) {
    details.addEventListener("toggle", () => {
      for (const canvas of details.querySelectorAll("[data-figure]")) {
        if (details.open && !canvas.dataset.drawn) draw(canvas);
      }
    });
  }
  const redraw = () => canvases.filter((canvas) => canvas.dataset.drawn).forEach(draw);
  dark.addEventListener("change", redraw);
  window.addEventListener("beforeprint", () => {
    printing = true;
    document.querySelectorAll("details").forEach((details) => { details.open = true; });
    canvases.forEach(draw);
  });
  window.addEventListener("afterprint", () => { printing = false; redraw(); });

  for (const row of document.querySelectorAll("tr[data-start]")) {
    row.addEventListener("click", () => {
      const [start, end] = [Number(row.dataset.start), Number(row.dataset.end)];
      const margin = 0.15 * (end - start) + 0.5;
      show(row.dataset.link, [start - margin, end + margin], null);
      document.getElementById(row.dataset.target).scrollIntoView({ behavior: "smooth" });
    });
  }
})();
