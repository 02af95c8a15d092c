// The first screen: the plot of the element that a cell of the strip names, commands to copy; the table of numbers, sorted and filtered.
"use strict";
(() => {
  const plotted = document.getElementById("worst");
  if (plotted && frf) {
    const title = plotted.querySelector(".title");
    const place = plotted.querySelector(".plot");
    const readout = plotted.querySelector("output");
    const rows = [...document.querySelectorAll(".strip div:not(.side)")].map((row) => [...row.children]);
    const cells = rows.flat();
    cells.forEach((cell) => (cell.title = cell.getAttribute("aria-label")));
    const off = new Set(["std of the model", "std of noise"]);
    let plots = [];
    let shown = cells.find((cell) => "worst" in cell.dataset) ?? null;
    const draw = () => {
      const q = Math.max(0, rows.findIndex((row) => row.includes(shown)));
      const e = shown ? rows[q].indexOf(shown) : 0;
      cells.forEach((cell) => cell.setAttribute("aria-pressed", String(cell === shown)));
      const response = frf.data.responses[q];
      plots.forEach((plot) => plot.destroy());
      title.textContent = `${response.name ?? response.title}: ${frf.name(response, e)}`;
      place.replaceChildren();
      const width = Math.max(220, place.clientWidth);
      const read = (text) => (readout.textContent = text);
      const drawn = frf.curves(response, "magnitude").filter((curve) => !off.has(curve.label));
      const y = frf.range(response, "magnitude", drawn.map((curve) => frf.values(response, curve.key, e)));
      const panel = (quantity, height, more) => frf.panel({ place: place.appendChild(document.createElement("div")), response, quantity, e, width, height, sync: "first", titled: false, off, read, ...more });
      plots = [panel("magnitude", 190, { y, bare: true }), panel("phase", 120)];
      frf.legend(plotted.querySelector(".key"), response, "magnitude", off);
    };
    cells.forEach((cell) =>
      cell.addEventListener("click", () => {
        shown = cell;
        draw();
      }),
    );
    plotted.hidden = false;
    draw();
    let resized;
    window.addEventListener("resize", () => {
      clearTimeout(resized);
      resized = setTimeout(draw, 150);
    });
    matchMedia("(prefers-color-scheme: dark)").addEventListener("change", draw);
  }

  // One configuration's modes at a time; paper has all of them, and what is folded.
  const modes = document.getElementById("mode-tabs");
  if (modes) {
    const rows = [...document.querySelectorAll("tr[data-mode]")];
    const names = [...new Set(rows.map((row) => row.dataset.row))];
    const show = (k) => rows.forEach((row) => (row.hidden = k !== null && row.dataset.row !== names[k]));
    let last = 0;
    const titles = names.map((name) => rows.find((row) => row.dataset.row === name).cells[0].textContent);
    modes.hidden = !frf || names.length < 2;
    if (!modes.hidden) frf.tabs(modes, titles, (k) => {
      show((last = k));
      rows.find((row) => !row.hidden)?.querySelector('button[aria-expanded="false"]')?.click(); // no drawing of a hidden row stays
    })(0);
    window.addEventListener("beforeprint", () => show(null));
    window.addEventListener("afterprint", () => names.length > 1 && show(last));
  }
  window.addEventListener("beforeprint", () => document.querySelectorAll("main details").forEach((one) => (one.open = true)));

  // A page in a file may not write to the clipboard everywhere: then the text is selected.
  const copy = async (text, from, button) => {
    const before = button.textContent;
    try {
      await navigator.clipboard.writeText(text);
      button.textContent = "copied";
    } catch {
      getSelection().selectAllChildren(from);
      button.textContent = document.execCommand("copy") ? "copied" : "press Ctrl+C";
    }
    setTimeout(() => (button.textContent = before), 1500);
  };
  document.querySelectorAll("button.copy").forEach((button) => {
    button.hidden = false;
    button.addEventListener("click", () => copy(button.previousElementSibling.textContent, button.previousElementSibling, button));
  });

  const table = document.getElementById("numbers-table");
  if (!table) return;
  const body = table.tBodies[0];
  const field = (text) => (/[",\n]/.test(text) ? `"${text.replaceAll('"', '""')}"` : text);
  const text = (cell) => cell.dataset.csv ?? cell.innerText.trim();
  const csv = () =>
    [table.tHead.rows[0], ...[...body.rows].filter((row) => !row.hidden)].map((row) => [...row.cells].map((cell) => field(text(cell))).join(",")).join("\n");
  const controls = document.getElementById("numbers-controls");
  controls.hidden = false;
  controls.querySelector("input").addEventListener("input", (event) => {
    const wanted = event.target.value.toLowerCase();
    [...body.rows].forEach((row) => (row.hidden = !row.innerText.toLowerCase().includes(wanted) && !row.textContent.toLowerCase().includes(wanted)));
  });
  const button = controls.querySelector("button");
  button.addEventListener("click", () => copy(csv(), table, button));
  [...table.tHead.rows[0].cells].forEach((head, column) => {
    if (!head.dataset.sort) return;
    const sorter = document.createElement("button");
    sorter.type = "button";
    sorter.append(...head.childNodes);
    head.append(sorter);
    sorter.addEventListener("click", () => {
      const up = head.getAttribute("aria-sort") !== "ascending";
      [...table.tHead.rows[0].cells].forEach((other) => other.removeAttribute("aria-sort"));
      head.setAttribute("aria-sort", up ? "ascending" : "descending");
      const key = (row) => row.cells[column].dataset.value ?? row.cells[column].innerText;
      const value = (row) => (Number.isFinite(Number(key(row))) ? Number(key(row)) : Number.MAX_VALUE); // unknown: last
      const order = (a, b) => (head.dataset.sort === "number" ? value(a) - value(b) : key(a).localeCompare(key(b)));
      body.append(...[...body.rows].sort((a, b) => (up ? 1 : -1) * order(a, b)));
    });
  });
})();
