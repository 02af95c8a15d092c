// The FRF matrix: tabs of configurations, thumbnails that open large, hover or step for numbers, drag to zoom.
"use strict";
(() => {
  const root = document.getElementById("explorer");
  if (!root || !frf) return;
  const { data } = frf;
  const [quantity, element, scale] = root.querySelectorAll("select");
  const grid = root.querySelector(".grid");
  const readout = root.querySelector("output");
  const key = root.querySelector(".key");
  const off = new Set(["std of the model"]);
  let panels = [];
  let chosen = 0;

  const read = (text) => (readout.textContent = text);
  const place = () => grid.appendChild(document.createElement("div"));

  const matrix = (response, linear) => {
    const n_u = response.inputs.length;
    const n = n_u * response.outputs.length;
    const one = n === 1;
    const width = Math.max(150, Math.min(one ? 900 : 420, Math.floor((grid.clientWidth - 8) / n_u) - 6));
    const height = one ? 420 : Math.max(120, Math.min(205, Math.round(0.6 * width)));
    const shown = frf.curves(response, quantity.value).filter((curve) => curve.ranged && !off.has(curve.label));
    const all = Array.from({ length: n }, (_, e) => shown.map((curve) => frf.values(response, curve.key, e))).flat();
    const y = frf.range(response, quantity.value, all);
    grid.style.gridTemplateColumns = `repeat(${n_u}, max-content)`;
    for (let e = 0; e < n; e++) {
      const cell = place();
      const open = cell.appendChild(document.createElement("button"));
      open.type = "button";
      open.className = "open";
      open.textContent = frf.name(response, e);
      open.setAttribute("aria-label", `Enlarge ${frf.name(response, e)}`);
      open.hidden = one;
      open.addEventListener("click", () => {
        element.value = String(e);
        draw();
        element.focus();
      });
      const within = cell.appendChild(document.createElement("div"));
      panels.push(frf.panel({ place: within, response, quantity: quantity.value, e, width, height, y, off, linear, read, titled: one, compact: !one }));
    }
  };

  const large = (response, e, linear) => {
    grid.style.gridTemplateColumns = "max-content";
    const width = Math.max(260, Math.min(1000, grid.clientWidth - 8));
    frf.quantities(response).forEach((kind, i) => {
      panels.push(frf.panel({ place: place(), response, quantity: kind, e, width, height: i ? 190 : 330, off, linear, read, titled: i === 0 }));
    });
  };

  const draw = () => {
    panels.forEach((plot) => plot.destroy());
    panels = [];
    grid.replaceChildren();
    readout.textContent = "Hover or step with the arrow keys for numbers, drag to zoom, double-click to zoom out.";
    const response = data.responses[chosen];
    const linear = scale.value === "linear";
    const whole = element.value === "";
    quantity.parentElement.hidden = !whole || frf.quantities(response).length < 2;
    if (whole) matrix(response, linear);
    else large(response, Number(element.value), linear);
    frf.legend(key, response, whole ? quantity.value : "magnitude", off, draw);
  };

  const choose = (i) => {
    chosen = i;
    const response = data.responses[i];
    const n = response.inputs.length * response.outputs.length;
    const [kind, one] = [quantity.value, element.value];
    element.replaceChildren(new Option("all elements", ""), ...Array.from({ length: n }, (_, e) => new Option(frf.name(response, e), String(e))));
    element.value = Number(one) < n ? one : "";
    element.parentElement.hidden = n < 2;
    quantity.replaceChildren(...frf.quantities(response).map((each) => new Option(data.quantities[each].title, each)));
    if (frf.quantities(response).includes(kind)) quantity.value = kind;
    draw();
  };

  // The panels as they are drawn, as SVG: lines, points, frame, labels of both axes, titles and names of the curves.
  const picture = () => {
    const tag = (name, all, text = "") => {
      const node = document.createElementNS("http://www.w3.org/2000/svg", name);
      for (const [attribute, value] of Object.entries(all)) node.setAttribute(attribute, value);
      node.textContent = text;
      return node;
    };
    const look = getComputedStyle(document.documentElement);
    const [ink, paper] = [look.getPropertyValue("--ink").trim(), look.getPropertyValue("--paper").trim()];
    const box = grid.getBoundingClientRect();
    const size = [grid.scrollWidth, grid.scrollHeight + 20];
    const svg = tag("svg", { width: size[0], height: size[1], viewBox: `0 -20 ${size.join(" ")}`, "font-family": "sans-serif", "font-size": 11 });
    svg.append(tag("rect", { y: -20, width: size[0], height: size[1], fill: paper }));
    [...key.children].filter((each) => each.getAttribute("aria-pressed") !== "false").reduce((x, each) => {
      svg.append(tag("text", { x, y: -6, fill: each.firstChild.style.color }, each.textContent));
      return x + 7 * each.textContent.length + 14;
    }, 4);
    for (const plot of panels) {
      const over = plot.over.getBoundingClientRect();
      const [x0, y0] = [over.left - box.left + grid.scrollLeft, over.top - box.top];
      const part = svg.appendChild(tag("svg", { x: x0, y: y0, width: over.width, height: over.height }));
      part.append(tag("rect", { width: over.width, height: over.height, fill: "none", stroke: ink }));
      const title = plot.root.querySelector(".u-title")?.textContent ?? plot.root.closest(".grid > div").querySelector(".open")?.textContent;
      svg.append(tag("text", { x: x0 + over.width / 2, y: y0 - 4, "text-anchor": "middle", fill: ink }, title));
      plot.axes.forEach(({ _splits, _values, scale: own, label }) => {
        const across = own === "x";
        _splits.forEach((value, i) => {
          const at = plot.valToPos(value, own);
          const where = across ? { x: x0 + at, y: y0 + over.height + 12, "text-anchor": "middle" } : { x: x0 - 4, y: y0 + at + 4, "text-anchor": "end" };
          if (_values[i] !== null && at >= 0 && at <= (across ? over.width : over.height)) svg.append(tag("text", { ...where, fill: ink }, _values[i]));
        });
        const middle = across ? `translate(${x0 + over.width / 2} ${y0 + over.height + 26})` : `translate(${x0 - 32} ${y0 + over.height / 2}) rotate(-90)`;
        if (label) svg.append(tag("text", { transform: middle, "text-anchor": "middle", fill: ink }, label));
      });
      const [lines] = plot.data;
      plot.series.slice(1).forEach((series, k) => {
        const points = lines.map((f, i) => [plot.valToPos(f, "x"), plot.data[k + 1][i]]).filter(([, y]) => y !== undefined && (series.spanGaps ? y !== null : true));
        const at = points.map(([x, y]) => (y === null ? null : [x.toFixed(1), plot.valToPos(y, "y").toFixed(1)]));
        const color = typeof series.stroke === "function" ? series.stroke(plot, k + 1) : series.stroke;
        if (color === "transparent") {
          const fill = series.points.fill(plot, k + 1);
          at.filter(Boolean).forEach(([cx, cy]) => part.append(tag("circle", { cx, cy, r: 1.6, fill })));
        } else {
          const path = at.map((point, i) => (point === null ? "" : `${i && at[i - 1] ? "L" : "M"}${point.join(" ")}`)).join("");
          part.append(tag("path", { d: path, fill: "none", stroke: color, "stroke-width": series.width, "stroke-dasharray": (series.dash ?? []).join(" ") }));
        }
      });
    }
    return [new XMLSerializer().serializeToString(svg), size];
  };

  const save = (kind) => {
    const [text, [width, height]] = picture();
    const address = `data:image/svg+xml;charset=utf-8,${encodeURIComponent(text)}`;
    const give = (href) => Object.assign(document.createElement("a"), { href, download: `${data.responses[chosen].name ?? "curves"}.${kind}` }).click();
    if (kind === "svg") return give(address);
    const image = new Image();
    image.onload = () => {
      const canvas = Object.assign(document.createElement("canvas"), { width: 2 * width, height: 2 * height });
      const context = canvas.getContext("2d");
      context.scale(2, 2);
      context.drawImage(image, 0, 0);
      give(canvas.toDataURL("image/png"));
    };
    image.src = address;
  };

  for (const button of root.querySelectorAll("[data-save]")) button.addEventListener("click", () => save(button.dataset.save));
  for (const select of [quantity, element, scale]) select.addEventListener("change", draw);
  let resized;
  window.addEventListener("resize", () => {
    clearTimeout(resized);
    resized = setTimeout(draw, 150);
  });
  matchMedia("(prefers-color-scheme: dark)").addEventListener("change", draw);
  root.hidden = false;
  const tabs = root.querySelector(".tabs");
  const select = frf.tabs(tabs, data.responses.map((response) => response.title), choose);
  tabs.hidden = data.responses.length < 2;
  select(0);
})();
