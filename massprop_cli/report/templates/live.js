"use strict";
// Figures under the pointer: values, and a stretch to zoom into. What is shown is read from the drawing itself, so page and chart agree.
(() => {
  const HEADING = /\[(?:10[⁻⁰¹²³⁴⁵⁶⁷⁸⁹]+ )?(.*)\]$/;
  const pairs = text => {
    const numbers = (text.match(/-?\d+(?:\.\d+)?/g) || []).map(Number);
    return Array.from({ length: numbers.length >> 1 }, (_, i) => [numbers[2 * i], numbers[2 * i + 1]]);
  };

  // a path's subpaths, in the data's units, with null between them
  function line(path, scale) {
    const x = [], y = [];
    for (const part of path.getAttribute("d").split("M").slice(1)) {
      if (x.length) { x.push(x[x.length - 1]); y.push(null); }
      for (const [right, down] of pairs(part)) { x.push(scale.x(right)); y.push(scale.y(down)); }
    }
    return [x, y];
  }

  // the lower and the upper edge of a filled band
  function edges(path, scale) {
    const at = new Map();
    for (const [right, down] of pairs(path.getAttribute("d"))) {
      const found = at.get(right) || [Infinity, -Infinity], y = scale.y(down);
      at.set(right, [Math.min(found[0], y), Math.max(found[1], y)]);
    }
    const x = [...at.keys()].sort((a, b) => a - b);
    return [0, 1].map(side => [x.map(scale.x), x.map(right => at.get(right)[side])]);
  }

  const ascending = x => x.length > 2 && x[0] < x[x.length - 1] && x.every((value, i) => i === 0 || value >= x[i - 1]);

  function read(svg) {
    const frame = svg.querySelector("[data-x]");
    if (!frame) return null;
    const [a, b] = frame.dataset.x.split(" ").map(Number), [c, d] = frame.dataset.y.split(" ").map(Number);
    const log = "log" in frame.dataset;
    const scale = { x: right => a + b * right, y: down => c + d * down };
    const corners = pairs(frame.querySelector("path").getAttribute("d"));
    const box = { left: corners[0][0], bottom: corners[0][1], right: corners[1][0], top: corners[2][1] };
    const texts = [...frame.querySelectorAll("text")].map(text => text.textContent);
    const unit = texts.map(text => text.match(HEADING)).filter((found, i) => found && !texts[i].startsWith("time [")).at(-1); // the title comes after what stands along the axes
    const series = [];
    for (const group of frame.querySelectorAll("g[id]")) {
      const path = group.querySelector("path[d]"), name = group.id.match(/(?:_([xyz]))?-([a-z]+)(?:-\d+)?$/);
      if (!path || !name || path.closest("defs")) continue; // markers alone
      const style = getComputedStyle(path);
      const look = { stroke: style.stroke, width: parseFloat(style.strokeWidth), dash: style.strokeDasharray, name: name[2] };
      if (style.fill === "none") {
        const found = line(path, scale);
        if (ascending(found[0])) series.push({ ...look, data: found });
      } else if (name[2] === "band") {
        for (const found of edges(path, scale)) series.push({ ...look, stroke: "transparent", fill: style.fill, data: found });
      }
    }
    return series.length ? { box, log, scale, series, unit: unit ? unit[1] : "", time: texts.includes("time [s]"), fine: Math.abs(d) / 100 } : null;
  }

  // as many decimals as a hundredth of a point on paper bears
  const written = (value, seen) => {
    if (value == null) return "–";
    if (seen.log) return (10 ** value).toExponential(2).replace("-", "−");
    const decimals = Math.max(0, Math.ceil(-Math.log10(seen.fine)));
    return (decimals > 6 && Math.abs(value) < 1e-3 ? value.toExponential(4) : value.toFixed(Math.min(decimals, 12))).replaceAll("-", "−");
  };

  const label = (tick, log) => {
    if (log) return Number.isInteger(tick) ? `1e${tick}` : "";
    return `${Math.abs(tick) > 0 && Math.abs(tick) < 1e-3 ? tick.toExponential(0) : +tick.toPrecision(6)}`.replaceAll("-", "−");
  };

  function said(chart, seen) {
    const index = chart.cursor.idx;
    if (index == null) return "";
    const near = column => {
      for (let step = 0; step < 40; step++) for (const i of [index - step, index + step]) if (column[i] != null) return column[i];
      return null;
    };
    const x = chart.data[0][index], told = new Map();
    seen.series.forEach((one, i) => { told.set(one.name, [...(told.get(one.name) || []), near(chart.data[i + 1])]); });
    const parts = [...told].map(([name, values]) =>
      name === "band" ? `± ${written((values[1] - values[0]) / 2, seen)}` : `${name} ${values.map(value => written(value, seen)).join(", ")}`);
    return `${seen.time ? `${x.toFixed(2)} s` : +x.toPrecision(4)}: ${parts.join("; ")} ${seen.unit}`;
  }

  function mount(panel, event) {
    const svg = panel.querySelector("svg"), seen = !panel.live && svg && read(svg);
    if (!seen) return;
    const view = svg.viewBox.baseVal, size = svg.getBoundingClientRect(), per = size.width / view.width;
    const top = (seen.box.top - 3) * per, host = document.createElement("div"), told = document.createElement("output");
    host.className = "live";
    host.style.top = `${top}px`;
    panel.append(host, told);
    const ink = getComputedStyle(document.body), grid = { stroke: ink.getPropertyValue("--grid"), width: 1 };
    const axis = { stroke: ink.getPropertyValue("--ink"), font: `${Math.round(7.5 * per)}px system-ui, sans-serif`, grid, ticks: { show: false }, gap: 3 };
    const y = [seen.scale.y(seen.box.bottom), seen.scale.y(seen.box.top)], x = [seen.scale.x(seen.box.left), seen.scale.x(seen.box.right)];
    const whole = chart => chart.scales.x.min == null || (chart.scales.x.min <= x[0] && chart.scales.x.max >= x[1]);
    const all = ({ data: [moments] }, low, high) => !(high > low) || (low <= moments[0] && high >= moments[moments.length - 1]);
    const values = seen.series.flatMap(one => one.data[1]).filter(value => value != null);
    const most = [values.reduce((a, b) => Math.min(a, b)), values.reduce((a, b) => Math.max(a, b))];
    const bands = [];
    seen.series.forEach((one, i) => { if (one.fill && bands.every(band => !band.series.includes(i + 1))) bands.push({ series: [i + 2, i + 1], fill: one.fill }); });
    const chart = new uPlot({
      width: size.width, height: size.height - top, legend: { show: false }, padding: [3 * per, (view.width - seen.box.right) * per, 0, 0],
      cursor: { drag: { x: true, y: false }, points: { size: 5 } }, bands,
      scales: {
        x: { time: false, range: (chart, low, high) => (all(chart, low, high) ? x : [Math.max(low, x[0]), Math.min(high, x[1])]) },
        y: { range: (_, low, high) => (low == null || (low <= most[0] && high >= most[1]) ? y : uPlot.rangeNum(low, high, 0.05, false)) },
      },
      axes: [
        { ...axis, size: (view.height - seen.box.bottom) * per },
        { ...axis, size: seen.box.left * per, values: (_, ticks) => ticks.map(tick => label(tick, seen.log)) },
      ],
      series: [{}, ...seen.series.map(one => ({
        stroke: one.stroke, width: one.width * per, points: { show: false },
        dash: one.dash === "none" ? undefined : one.dash.split(/[ ,]+/).map(part => parseFloat(part) * per),
      }))],
      hooks: {
        setCursor: [chart => { told.textContent = said(chart, seen); }],
        ready: [chart => {
          const over = chart.over.getBoundingClientRect();
          chart.setCursor({ left: event.clientX - over.left, top: event.clientY - over.top });
        }],
      },
    }, uPlot.join(seen.series.map(one => one.data)), host);
    panel.live = { chart, host, told, zoomed: () => !whole(chart) };
  }

  function leave(panel) {
    if (!panel.live) return;
    panel.live.chart.destroy();
    panel.live.host.remove();
    panel.live.told.remove();
    panel.live = null;
  }

  const panels = [...document.querySelectorAll(".panel")];
  for (const panel of panels) {
    panel.addEventListener("pointerenter", event => { if (event.pointerType === "mouse") mount(panel, event); });
    panel.addEventListener("pointerleave", event => { if (event.pointerType === "mouse" && panel.live && !panel.live.zoomed()) leave(panel); });
    panel.addEventListener("click", event => { if (event.pointerType !== "mouse") { panels.forEach(other => { if (other !== panel) leave(other); }); mount(panel, event); } });
  }
  addEventListener("resize", () => panels.forEach(leave));
  addEventListener("beforeprint", () => panels.forEach(leave));
})();
