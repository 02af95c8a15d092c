// The FRF matrix, or curves of other kinds: choose a configuration, hover for numbers, drag to zoom, double-click to zoom out.
"use strict";
(() => {
  const NOT_FINITE = -32768;
  const data = JSON.parse(document.getElementById("frf-data").textContent);
  const root = document.getElementById("explorer");
  const [configuration, quantity, element] = root.querySelectorAll("select");
  const grid = root.querySelector(".grid");
  const readout = root.querySelector("output");
  let panels = [];

  // Few values stand as they are.
  const decoded = (text, step) => {
    if (Array.isArray(text)) return text;
    const bytes = Uint8Array.from(atob(text), (letter) => letter.charCodeAt(0));
    const view = new DataView(bytes.buffer);
    return Array.from({ length: bytes.length / 2 }, (_, i) => {
      const value = view.getInt16(2 * i, true);
      return value === NOT_FINITE ? null : value * step;
    });
  };

  const curves = (response) => data.quantities[quantity.value].curves.filter((curve) => curve.key in response.curves);

  const range = (response, drawn) => {
    if (response.range) return response.range;
    if (data.quantities[quantity.value].range) return data.quantities[quantity.value].range;
    const shown = drawn.filter((curve) => curve.ranged).flatMap((curve) => curve.values.filter((v) => v !== null));
    const low = Math.max(shown.reduce((a, b) => Math.min(a, b), Infinity), shown.reduce((a, b) => Math.max(a, b), -Infinity) - 120);
    const high = shown.reduce((a, b) => Math.max(a, b), -Infinity);
    return shown.length ? [low - 5, high + 5] : [-100, 0];
  };

  const series = (curve) => ({
    label: curve.label,
    stroke: curve.points ? "transparent" : curve.color,
    width: curve.width,
    dash: curve.dash,
    points: { show: curve.points, size: 4, width: 0, fill: curve.color, stroke: curve.color },
  });

  const number = (value) => {
    if (value === null || value === undefined) return "–";
    const { digits } = data.quantities[quantity.value];
    return digits === null ? value.toPrecision(4) : value.toFixed(digits);
  };

  const read = (plot, response, name) => {
    const at = plot.cursor.idx;
    if (at === null || at === undefined) return;
    const values = plot.series.slice(1).map((one, i) => `${one.label} ${number(plot.data[i + 1][at])}`);
    const unit = response.unit ?? data.quantities[quantity.value].unit;
    readout.textContent = `${name}, ${plot.data[0][at]} ${response.x_unit ?? data.frequency_unit}: ${values.join(", ")} ${unit}`;
  };

  // Numbers at 1, 2 and 5 of each decade.
  const labelled = (f) => ([1, 2, 5].includes(Math.round(f / 10 ** Math.floor(Math.log10(f) + 1e-9))) ? f : null);

  const panel = (response, drawn, y, row, column, width, height) => {
    const F = response.freq.length;
    const start = (row * response.inputs.length + column) * F;
    const name = `${response.inputs[column]} → ${response.outputs[row]}`;
    const place = grid.appendChild(document.createElement("div"));
    place.title = name;
    const plot = new uPlot(
      {
        width,
        height,
        title: name,
        legend: { show: false },
        cursor: { sync: { key: "frf", scales: ["x", null] }, drag: { x: true, y: false } },
        scales: { x: { time: false, distr: 3, range: (_, low, high) => [low, high] }, y: { range: () => y } },
        axes: [{ size: 28, font: "11px sans-serif", filter: (_, values) => values.map(labelled) }, { size: 44, font: "11px sans-serif" }],
        series: [{ label: "frequency" }, ...drawn.map(series)],
        hooks: { setCursor: [(self) => self.cursor.event && read(self, response, name)] },
      },
      [response.freq, ...drawn.map((curve) => curve.values.slice(start, start + F))],
      place,
    );
    panels.push(plot);
  };

  const draw = () => {
    panels.forEach((plot) => plot.destroy());
    panels = [];
    grid.replaceChildren();
    readout.textContent = "Hover for numbers, drag to zoom, double-click to zoom out.";
    const response = data.responses[Number(configuration.value)];
    const step = data.quantities[quantity.value].step;
    const drawn = curves(response).map((curve) => ({ ...curve, values: decoded(response.curves[curve.key], step) }));
    const y = range(response, drawn);
    const n_u = response.inputs.length;
    const one = element.value === "" ? null : Number(element.value);
    const width = Math.max(150, Math.floor((grid.clientWidth - 8) / (one === null ? n_u : 1)) - 6);
    const height = Math.max(130, Math.min(one === null ? 240 : 460, Math.round(0.7 * width)));
    grid.style.gridTemplateColumns = `repeat(${one === null ? n_u : 1}, max-content)`;
    for (let row = 0; row < response.outputs.length; row++)
      for (let column = 0; column < n_u; column++)
        if (one === null || one === row * n_u + column) panel(response, drawn, y, row, column, width, height);
    root.querySelector(".key").replaceChildren(
      ...drawn.filter((curve) => curve.color !== "transparent").map((curve) => {
        const label = document.createElement("span");
        label.textContent = `${curve.points ? "●" : curve.dash ? "┅" : "━"} ${curve.label}`;
        label.style.color = curve.color;
        return label;
      }),
    );
  };

  const elements = () => {
    const response = data.responses[Number(configuration.value)];
    const names = response.outputs.flatMap((y) => response.inputs.map((u) => `${u} → ${y}`));
    element.replaceChildren(new Option("all elements", ""), ...names.map((name, i) => new Option(name, String(i))));
    element.parentElement.hidden = names.length < 2;
    draw();
  };

  data.responses.forEach((response, i) => configuration.add(new Option(response.title, String(i))));
  Object.entries(data.quantities).forEach(([key, kind]) => quantity.add(new Option(kind.title, key)));
  quantity.parentElement.hidden = Object.keys(data.quantities).length < 2;
  configuration.addEventListener("change", elements);
  quantity.addEventListener("change", draw);
  element.addEventListener("change", draw);
  let resized;
  window.addEventListener("resize", () => {
    clearTimeout(resized);
    resized = setTimeout(draw, 150);
  });
  root.hidden = false;
  elements();
})();
