// The modes in motion: a button of the table shows a mode, its sticks swinging about the robot at rest.
"use strict";
(() => {
  const PERIOD = 1600; // ms of a swing, whatever the frequency
  const MAX_WIDTH = 330; // px of a view
  const MAX_HEIGHT = 230;
  const MIN_ASPECT = 0.3; // shorter over longer span of a view
  const WIDTHS = { arm: 4, strut: 2.2, mass: 1.3 };
  const data = JSON.parse(document.getElementById("mode-data").textContent);
  const root = document.getElementById("mode-viewer");
  const [title, energy] = root.querySelectorAll("p");
  const views = root.querySelector(".views");
  const button = root.querySelector("button");
  const place = document.createElement("tr");
  const calm = matchMedia("(prefers-reduced-motion: reduce)");
  let shown = null; // the button in the table
  let moving = []; // functions that draw the sticks of each view at an angle of the swing
  let phase = 0; // in periods
  let playing = false;

  const svg = (parent, name, attributes, text) => {
    const element = parent.appendChild(document.createElementNS("http://www.w3.org/2000/svg", name));
    Object.entries(attributes).forEach(([key, value]) => element.setAttribute(key, value));
    if (text) element.textContent = text;
    return element;
  };

  // Coordinates of the points in m at an angle of the swing; null: at rest.
  const positions = (row, mode, angle) => {
    const c = angle === null ? 0 : Math.cos(angle);
    const s = angle === null ? 0 : Math.sin(angle);
    return row.points.map((p, i) => row.step * (p + c * mode.re[i] - s * mode.im[i]));
  };

  const range = (row, mode, axis) => {
    const of = (i) => row.step * Math.hypot(mode.re[i], mode.im[i]);
    const ends = row.points.flatMap((p, i) => (i % 3 === axis ? [row.step * p - of(i), row.step * p + of(i)] : []));
    return [Math.min(...ends), Math.max(...ends)];
  };

  // Spans of a view to the right and upwards; a flat one is widened.
  const spans = (row, mode, axes) => {
    const ranges = axes.map((axis) => range(row, mode, axis));
    const least = MIN_ASPECT * Math.max(...ranges.map(([low, high]) => high - low));
    return ranges.map(([low, high]) => {
      const more = Math.max(0, least - (high - low)) / 2;
      return [low - more, high + more];
    });
  };

  // 1, 2 or 5 of a decade, for about so many ticks.
  const spacing = (length, count) => {
    const rough = length / count;
    const decade = 10 ** Math.floor(Math.log10(rough));
    return decade * ([1, 2, 5].find((digit) => digit * decade >= rough) ?? 10);
  };

  const ticks = ([low, high], count) => {
    const step = spacing(high - low, count);
    const first = Math.ceil(low / step - 1e-9);
    return Array.from({ length: Math.floor(high / step + 1e-9) - first + 1 }, (_, i) => Number(((first + i) * step).toPrecision(6)));
  };

  // Paths for one set of sticks; returns a function that draws them at given points.
  const sticks = (parent, row, at, look) => {
    const group = svg(parent, "g", { fill: "none", "stroke-linecap": "round", ...look });
    const paths = Object.entries(WIDTHS).map(([kind, width]) => {
      const links = row.links.filter((link) => link[2] === kind);
      return [svg(group, "path", { "stroke-width": width }), (points) => links.map(([a, b]) => `M${at(points, a)}L${at(points, b)}`)];
    });
    paths.push([svg(group, "path", { "stroke-width": 7 }), (points) => row.joints.map((i) => `M${at(points, i)}h0`)]);
    return (points) => paths.forEach(([path, d]) => path.setAttribute("d", d(points).join("")));
  };

  const view = (row, mode, [right, up], scale) => {
    const [x, y] = spans(row, mode, [right, up]);
    const down = up === row.down;
    const [width, height] = [scale * (x[1] - x[0]), scale * (y[1] - y[0])];
    const [left, top] = [46, 14];
    const px = (value) => left + scale * (value - x[0]);
    const py = (value) => top + scale * (down ? value - y[0] : y[1] - value);
    const at = (points, i) => `${px(points[3 * i + right]).toFixed(1)} ${py(points[3 * i + up]).toFixed(1)}`;
    const box = { width: width + left + 14, height: height + top + 40 };
    const frame = svg(views, "svg", { ...box, viewBox: `0 0 ${box.width} ${box.height}`, role: "img" });
    svg(frame, "title", {}, `${"xyz"[right]} to the right and ${"xyz"[up]} upwards, in m`);
    const lines = svg(frame, "g", { stroke: "var(--line)", "stroke-width": 1 });
    const text = svg(frame, "g", { "font-size": 11, fill: "var(--weak)" });
    for (const value of ticks(x, 4)) {
      svg(lines, "path", { d: `M${px(value)} ${top - 8}V${top + height + 8}` });
      svg(text, "text", { x: px(value), y: top + height + 20, "text-anchor": "middle" }, String(value));
    }
    for (const value of ticks(y, 4)) {
      svg(lines, "path", { d: `M${left - 8} ${py(value)}H${left + width + 8}` });
      svg(text, "text", { x: left - 10, y: py(value) + 4, "text-anchor": "end" }, String(value));
    }
    svg(text, "text", { x: left + width / 2, y: top + height + 36, "text-anchor": "middle" }, `${"xyz"[right]} in m`);
    svg(text, "text", { x: 11, y: top + height / 2, "text-anchor": "middle", transform: `rotate(-90 11 ${top + height / 2})` }, `${"xyz"[up]} in m`);
    const foot = at(row.points.map((p) => row.step * p), 0).split(" ");
    svg(frame, "rect", { x: foot[0] - 5, y: foot[1] - 5, width: 10, height: 10, fill: "var(--ink)" });
    sticks(frame, row, at, { stroke: data.colors.rest, class: "rest" })(positions(row, mode, null));
    sticks(frame, row, at, { stroke: data.colors.back, opacity: 0.3, class: "end" })(positions(row, mode, Math.PI));
    sticks(frame, row, at, { stroke: data.colors.ahead, opacity: 0.3, class: "end" })(positions(row, mode, 0));
    const swing = sticks(frame, row, at, { stroke: data.colors.ahead, class: "moving" });
    moving.push((angle) => swing(positions(row, mode, angle)));
  };

  let last = null;
  const step = (now) => {
    if (!playing) return;
    if (last !== null) phase = (phase + (now - last) / PERIOD) % 1;
    last = now;
    moving.forEach((draw) => draw(2 * Math.PI * phase));
    requestAnimationFrame(step);
  };

  const play = (on) => {
    if (on && !playing) requestAnimationFrame(step);
    last = null;
    playing = on;
    button.textContent = on ? "Pause" : "Play";
  };

  const close = () => {
    play(false);
    place.remove();
    shown?.setAttribute("aria-expanded", "false");
    shown = null;
  };

  const open = (chosen, tr, row, mode) => {
    close();
    shown = chosen;
    chosen.setAttribute("aria-expanded", "true");
    tr.after(place);
    title.textContent = mode.title;
    energy.textContent = mode.energy && `Energy: ${mode.energy}.`;
    views.replaceChildren();
    moving = [];
    const sizes = mode.views.map((axes) => spans(row, mode, axes).map(([low, high]) => high - low));
    const scale = Math.min(...sizes.map(([wide, high]) => Math.min(MAX_WIDTH / wide, MAX_HEIGHT / high)));
    mode.views.forEach((axes) => view(row, mode, axes, scale));
    phase = 0;
    moving.forEach((draw) => draw(0));
  };

  const cell = place.appendChild(document.createElement("td"));
  place.className = "mode-drawing";
  cell.append(root);
  root.hidden = false;
  button.addEventListener("click", () => play(!playing));
  calm.addEventListener("change", () => calm.matches && play(false));

  let first = null, elastic = null; // a pendulum is no elastic mode
  document.querySelectorAll("tr[data-mode]").forEach((tr) => {
    const row = data.rows[Number(tr.dataset.row)];
    if (row === null) return;
    const mode = row.modes[Number(tr.dataset.mode)];
    const number = tr.cells[1];
    const chooser = document.createElement("button");
    chooser.textContent = number.textContent;
    chooser.title = `Show ${mode.title}`;
    chooser.setAttribute("aria-expanded", "false");
    number.replaceChildren(chooser);
    cell.colSpan = tr.cells.length;
    chooser.addEventListener("click", () => {
      if (shown === chooser) return close();
      open(chooser, tr, row, mode);
      play(!calm.matches);
    });
    const show = () => open(chooser, tr, row, mode);
    first ??= show;
    if ("elastic" in tr.dataset) elastic ??= show;
  });
  (elastic ?? first)?.();
})();
