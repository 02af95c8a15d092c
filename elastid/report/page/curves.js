// The data of the page, decoded once, and one panel of curves; frequencies, dB and degrees are made here from complex numbers.
"use strict";
const frf = (() => {
  const element = document.getElementById("frf-data");
  if (!element) return null;
  const data = JSON.parse(element.textContent);
  const decoded = new Map();

  const floats = (text) => {
    if (!decoded.has(text)) decoded.set(text, new Float32Array(Uint8Array.from(atob(text), (letter) => letter.charCodeAt(0)).buffer));
    return decoded.get(text);
  };
  const real = (response, key, e, i, n) => floats(response.arrays[key])[e * n + i];
  const complex = (response, key, e, i, n) => {
    const all = floats(response.arrays[key]);
    return [all[2 * (e * n + i)], all[2 * (e * n + i) + 1]];
  };
  const G = (response, e, i) => complex(response, "G", e, i, response.at.length);
  const model = (response, e, i) => complex(response, "model", e, i, response.freq.length);
  const std = (response, e, i) => real(response, "std", e, i, response.freq.length);
  const at = (key) => (response, e, i) => real(response, key, e, i, response.at.length);
  const db = (value) => (value > 0 && Number.isFinite(value) ? 20 * Math.log10(value) : null);
  const size = ([re, im]) => Math.hypot(re, im);
  const degrees = ([re, im]) => (Number.isFinite(re + im) ? (180 / Math.PI) * Math.atan2(im, re) : null);
  const left = (response, e, i) => {
    const [a, b] = [G(response, e, i), model(response, e, response.at[i])];
    return Math.hypot(a[0] - b[0], a[1] - b[1]);
  };
  const finite = (value) => (Number.isFinite(value) ? value : null);

  // Of an element e, at a measured line i; and at a line i of the model.
  const measured = {
    measured: (r, e, i) => db(size(G(r, e, i))),
    measured_phase: (r, e, i) => degrees(G(r, e, i)),
    residual: (r, e, i) => db(left(r, e, i)),
    noise: (r, e, i) => db(at("noise")(r, e, i)),
    total: (r, e, i) => db(at("total")(r, e, i)),
    coherence: (r, e, i) => finite(at("coherence")(r, e, i)),
    ratio: (r, e, i) => finite(left(r, e, i) / at("total" in r.arrays ? "total" : "noise")(r, e, i)),
  };
  const modelled = {
    fitted: (r, e, i) => db(size(model(r, e, i))),
    fitted_phase: (r, e, i) => degrees(model(r, e, i)),
    low: (r, e, i) => db(Math.max(size(model(r, e, i)) - 1.96 * std(r, e, i), 1e-3 * size(model(r, e, i)))),
    high: (r, e, i) => db(size(model(r, e, i)) + 1.96 * std(r, e, i)),
    model: (r, e, i) => db(std(r, e, i)),
  };

  // Values on all lines of a response; null where there is none.
  const values = (response, key, e) => {
    if (key in modelled) return response.freq.map((_, i) => modelled[key](response, e, i));
    const all = new Array(response.freq.length).fill(null);
    response.at.forEach((place, i) => (all[place] = measured[key](response, e, i)));
    return all;
  };
  const has = (response, curve) => curve.needs.every((key) => key in response.arrays);
  const curves = (response, quantity) => data.quantities[quantity].curves.filter((curve) => has(response, curve));
  const quantities = (response) => Object.keys(data.quantities).filter((key) => curves(response, key).length);

  const extent = (all) => {
    const known = all.flat().filter((v) => v !== null);
    return known.reduce(([low, high], v) => [Math.min(low, v), Math.max(high, v)], [Infinity, -Infinity]);
  };
  const range = (response, quantity, shown) => {
    const fixed = data.quantities[quantity].range;
    if (fixed) return fixed;
    const [low, high] = extent(shown);
    if (!(low <= high)) return [0, 1];
    return data.quantities[quantity].unit === "dB" ? [Math.max(low, high - 120) - 5, high + 5] : [Math.min(0, low), 1.05 * high || 1];
  };

  const number = (value, quantity) => {
    if (value === null || value === undefined) return "–";
    const { digits } = data.quantities[quantity];
    return value.toFixed(digits);
  };
  // A line breaks where the phase jumps from one end of the circle to the other.
  const broken = (all, quantity) =>
    quantity === "phase" ? all.map((v, i) => (i && v !== null && all[i - 1] !== null && Math.abs(v - all[i - 1]) > 180 ? null : v)) : all;
  const labelled = (f) => ([1, 2, 5].includes(Math.round(f / 10 ** Math.floor(Math.log10(f) + 1e-9))) ? f : null);
  const name = (response, e) => `${response.inputs[e % response.inputs.length]} → ${response.outputs[Math.floor(e / response.inputs.length)]}`;

  // options: place, response, quantity, e, width, height, y (range), off (labels not shown), linear, read, sync, titled, compact, bare (no title of the frequencies).
  const panel = (options) => {
    const { place, response, quantity, e, off = new Set(), read } = options;
    const shown = curves(response, quantity).filter((curve) => !off.has(curve.label));
    const all = shown.map((curve) => values(response, curve.key, e));
    const y = options.y ?? range(response, quantity, shown.flatMap((curve, i) => (curve.ranged ? [all[i]] : [])));
    const look = getComputedStyle(document.documentElement);
    const [ink, grid] = [look.getPropertyValue("--weak").trim(), look.getPropertyValue("--line").trim()];
    const axis = { stroke: ink, grid: { stroke: grid, width: 1 }, ticks: { show: false }, font: "11px sans-serif", labelFont: "11px sans-serif", labelSize: 16 };
    const kind = data.quantities[quantity];
    const unit = kind.unit;
    const x_unit = data.frequency_unit;
    const lines = response.at ?? response.freq.map((_, i) => i);
    const text = (at) => {
      const said = shown.map((curve, i) => [curve, all[i][at]]).filter(([curve]) => !curve.unread);
      const labels = [...new Set(said.map(([curve]) => curve.label))]; // both ends of a band have one
      const of = (label) => said.filter(([curve]) => curve.label === label).map(([, v]) => number(v, quantity));
      return `${name(response, e)}, ${response.freq[at]} ${x_unit}: ${labels.map((label) => `${label} ${of(label).join(" to ")}`).join(", ")} ${unit}`;
    };
    const nearest = (index) => lines.reduce((best, i) => (Math.abs(response.freq[i] - response.freq[index]) < Math.abs(response.freq[best] - response.freq[index]) ? i : best));
    const band = (low, high) => [shown.findIndex((c) => c.key === high) + 1, shown.findIndex((c) => c.key === low) + 1];
    const edges = band("low", "high");
    const plot = new uPlot(
      {
        width: options.width,
        height: options.height,
        title: options.titled === false ? undefined : options.title ?? name(response, e),
        legend: { show: false },
        cursor: { sync: { key: options.sync ?? "frf", scales: ["x", null] }, drag: { x: true, y: false } },
        scales: { x: { time: false, distr: options.linear ? 1 : 3, range: (_, low, high) => [low, high] }, y: { range: () => y } },
        axes: [
          { ...axis, size: 26, ...(options.linear ? {} : { filter: (_, ticks) => ticks.map(labelled) }), ...(options.compact || options.bare ? {} : { label: `frequency, ${x_unit}` }) },
          { ...axis, size: 40, ...(quantity === "phase" ? { splits: [-180, -90, 0, 90, 180], filter: (_, ticks) => (options.height < 160 ? ticks.map((v) => (v % 180 ? null : v)) : ticks) } : {}), ...(options.compact ? {} : { label: kind.title }) },
        ],
        bands: edges.every(Boolean) ? [{ series: edges, fill: shown[edges[0] - 1].fill }] : [],
        series: [{ label: "frequency" }, ...shown.map((curve) => ({
          label: curve.label,
          stroke: curve.points ? "transparent" : curve.color,
          width: curve.width,
          dash: curve.dash,
          spanGaps: !curve.points && quantity !== "phase",
          points: { show: curve.points, size: options.compact ? 3 : 4, width: 0, fill: curve.color, stroke: curve.color },
        }))],
        hooks: { setCursor: [(self) => self.cursor.event && self.cursor.idx != null && read?.(text(nearest(self.cursor.idx)))] },
      },
      [response.freq, ...all.map((one, i) => (shown[i].points ? one : broken(one, quantity)))],
      place,
    );
    place.tabIndex = 0;
    place.setAttribute("role", "group");
    place.setAttribute("aria-label", `${kind.title} of ${name(response, e)}; arrow keys step through the lines`);
    let line = -1;
    place.addEventListener("keydown", (event) => {
      const step = { ArrowRight: 1, ArrowLeft: -1 }[event.key];
      if (!step) return;
      event.preventDefault();
      line = Math.max(0, Math.min(lines.length - 1, line + step));
      plot.setCursor({ left: plot.valToPos(response.freq[lines[line]], "x"), top: plot.over.clientHeight / 2 });
      read?.(text(lines[line]));
    });
    return plot;
  };

  // A button for each curve that switches it; without `changed` the names of what is drawn.
  const legend = (place, response, shown, off, changed) =>
    place.replaceChildren(
      ...data.quantities[shown].curves
        .filter((curve) => has(response, curve) && !curve.unread && curve.color !== "transparent" && (changed || !off.has(curve.label)))
        .filter((curve, i, all) => all.findIndex((other) => other.label === curve.label) === i)
        .map((curve) => {
          const button = document.createElement(changed ? "button" : "span");
          const mark = document.createElement("span");
          mark.textContent = curve.points ? "●" : curve.dash ? "┅" : "━";
          mark.style.color = curve.color;
          mark.setAttribute("aria-hidden", "true");
          button.append(mark, ` ${curve.label}`);
          if (!changed) return button;
          button.type = "button";
          button.setAttribute("aria-pressed", String(!off.has(curve.label)));
          button.addEventListener("click", () => {
            off.has(curve.label) ? off.delete(curve.label) : off.add(curve.label);
            changed();
          });
          return button;
        }),
    );

  // Tabs with the keyboard of their kind: arrows move between them.
  const tabs = (place, names, chosen) => {
    const buttons = names.map((text, i) => {
      const button = document.createElement("button");
      button.type = "button";
      button.textContent = text;
      button.setAttribute("role", "tab");
      button.addEventListener("click", () => select(i));
      button.addEventListener("keydown", (event) => {
        const step = { ArrowRight: 1, ArrowLeft: -1 }[event.key];
        if (step) select((i + step + names.length) % names.length, true);
      });
      return button;
    });
    const select = (i, focus) => {
      buttons.forEach((button, k) => {
        button.setAttribute("aria-selected", String(k === i));
        button.tabIndex = k === i ? 0 : -1;
      });
      if (focus) buttons[i].focus();
      chosen(i);
    };
    place.setAttribute("role", "tablist");
    place.replaceChildren(...buttons);
    return select;
  };

  return { data, values, curves, quantities, range, panel, legend, tabs, name };
})();
