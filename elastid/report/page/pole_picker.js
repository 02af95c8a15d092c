// Poles over the order of the estimator: a click takes a pole or gives it back, and writes the line for the study.
"use strict";
(() => {
  const [WIDTH, HEIGHT, LEFT, TOP, RIGHT, BOTTOM] = [900, 320, 50, 10, 10, 42];
  const NEAR = 0.005; // of a frequency, within which a pole is the one that is taken
  const data = JSON.parse(document.getElementById("pole-data").textContent);

  const svg = (parent, name, attributes, text) => {
    const element = parent.appendChild(document.createElementNS("http://www.w3.org/2000/svg", name));
    Object.entries(attributes).forEach(([key, value]) => element.setAttribute(key, value));
    if (text) element.textContent = text;
    return element;
  };

  const picker = (root, row) => {
    let taken = [...row.taken];
    const [low, high] = row.band;
    const highest = Math.max(...row.order, 2);
    const px = (f) => LEFT + ((f - low) / (high - low)) * (WIDTH - LEFT - RIGHT);
    const py = (share) => TOP + (1 - share) * (HEIGHT - TOP - BOTTOM);
    const frame = svg(root, "svg", { viewBox: `0 0 ${WIDTH} ${HEIGHT}`, width: "100%", role: "img" });
    svg(frame, "title", {}, `Poles by frequency (${row.unit}) and order; a click takes a pole or gives it back`);
    const curve = row.level.map((share, i) => `${i ? "L" : "M"}${px(row.at[i]).toFixed(1)} ${py(share).toFixed(1)}`);
    svg(frame, "path", { d: curve.join(""), fill: "none", stroke: data.colors.weak });
    const text = svg(frame, "g", { "font-size": 12, fill: "var(--weak)", "text-anchor": "middle" });
    for (let i = 0; i <= 8; i++) {
      const f = low + (i * (high - low)) / 8;
      svg(text, "text", { x: px(f), y: HEIGHT - 22 }, String(Number(f.toPrecision(3))));
    }
    svg(text, "text", { x: (LEFT + WIDTH) / 2, y: HEIGHT - 5 }, `frequency in ${row.unit}`);
    svg(text, "text", { x: 20, y: py(1) + 8 }, String(highest));
    svg(text, "text", { x: 20, y: py(0) }, "order");
    const lines = svg(frame, "g", { stroke: data.colors.taken, "stroke-width": 1.5 });
    const line = root.parentElement.querySelector("pre");

    const show = () => {
      taken.sort((a, b) => a - b);
      lines.replaceChildren();
      taken.forEach((f) => svg(lines, "path", { d: `M${px(f)} ${py(1)}V${py(0)}` }));
      const list = `poles_hz: [${taken.map((f) => Number(f.toPrecision(6))).join(", ")}]`;
      line.textContent = taken.length ? (row.has_section ? `  ${list}` : `modal:\n  ${list}`) : "# no pole is taken";
    };

    row.freq.forEach((f, i) => {
      const stable = row.stable[i];
      const look = { r: stable ? 3.5 : 2, fill: stable ? data.colors.stable : data.colors.weak, cursor: "pointer" };
      const dot = svg(frame, "circle", { cx: px(f).toFixed(1), cy: py(row.order[i] / highest).toFixed(1), ...look });
      svg(dot, "title", {}, `${Number(f.toPrecision(6))} ${row.unit}, ${(100 * row.zeta[i]).toPrecision(3)} %, order ${row.order[i]}`);
      dot.addEventListener("click", () => {
        const rest = taken.filter((other) => Math.abs(other / f - 1) > NEAR);
        taken = rest.length < taken.length ? rest : [...taken, f];
        show();
      });
    });
    show();
  };

  document.querySelectorAll("[data-poles]").forEach((root) => {
    root.parentElement.hidden = false;
    picker(root, data.rows[Number(root.dataset.poles)]);
  });
})();
