// The FRF matrix, or curves of other kinds: tabs of configurations, thumbnails that open large, hover or step for numbers, drag to zoom.
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
    scale.parentElement.hidden = Boolean(response.curves);
    draw();
  };

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
