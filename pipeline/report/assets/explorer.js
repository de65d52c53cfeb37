// Every test of the study: a table, two plots that choose rows of it, and the chosen test in detail.
"use strict";
(async () => {
  const { init, Tabulator } = libraries;
  const at = id => document.getElementById(id);
  const PASSED = "no failure", DRAWN = 3000, FEW = 14;
  const { fields, colours } = await unpacked(at("explorer-data").textContent);
  const thumbnails = JSON.parse(at("explorer-thumbnails").textContent);
  const rows = asRows(fields);
  const named = Object.fromEntries(fields.map(field => [field.name, field]));
  const axes = [named.adj_ttc_s, ...fields.filter(field => field.variable)];
  const brushed = new Map();  // What each plot chooses: a function of a row.
  const served = "served" in document.documentElement.dataset;  // By `python -m pipeline explore`, which makes films.
  let asking = new AbortController(), fetched = "";
  const parallel = chart("explorer-parallel"), scatter = chart("explorer-scatter");

  const table = new Tabulator("#explorer-table", {
    data: rows, columns: fields.map(column), height: "420px", rowFormatter: reachable, placeholder: "No tests match.",
    initialSort: [{ column: "adj_ttc_s", dir: "asc" }],
  });
  table.on("rowClick", (_, row) => choose(row.getData()));
  table.on("tableBuilt", () => {
    label();
    // Rows take the focus, and a grid may have no other child that does.
    document.querySelector(".tabulator-tableholder").removeAttribute("tabindex");
  });
  let drawn = null;
  table.on("dataFiltered", (_, left) => {
    say(left.map(row => row.getData()));
    const filters = JSON.stringify(table.getHeaderFilters());
    if (filters === drawn) return;
    const chosen = brushed.size;  // Drawn anew, the plots choose nothing.
    drawn = filters;
    draw(rows.filter(kept(table.getHeaderFilters())));
    if (chosen) queueMicrotask(() => table.clearFilter());
  });
  parallel.on("axisareaselected", event => {
    const field = named[event.parallelAxisId], areas = event.intervals;
    brush(field.name, areas.length ? row => areas.some(([low, high]) => within(ordinal(field, row), low, high)) : null);
  });
  scatter.on("brushEnd", ({ areas: [area] }) => {
    if (!area) return brush("scatter", null);
    const [[left, right], [low, high]] = area.coordRange;
    brush("scatter", row => within(row.index, left, right) && within(row.adj_ttc_s, low, high));
  });
  for (const plot of [parallel, scatter]) plot.on("click", event => event.data && choose(rows[event.data.row ?? event.data.value[2]]));
  at("explorer-area").onclick = () => area(at("explorer-area").getAttribute("aria-pressed") !== "true");
  at("explorer-reset").onclick = reset;
  for (const button of document.querySelectorAll(".copy")) button.onclick = () => copy(button);
  for (const card of document.querySelectorAll("[data-region]")) card.addEventListener("click", event => showRegion(card, event.target));
  addEventListener("resize", () => { parallel.resize(); scatter.resize(); });
  together([...document.querySelectorAll(".drive")]);
  draw(rows);
  at("explorer").setAttribute("data-ready", "");

  async function unpacked(text) {
    const bytes = Uint8Array.from(atob(text), character => character.charCodeAt(0));
    return new Response(new Blob([bytes]).stream().pipeThrough(new DecompressionStream("gzip"))).json();
  }

  function asRows(fields) {
    return Array.from(fields[0].codes, (_, number) => {
      const row = { number };
      for (const field of fields) row[field.name] = field.numbers ? field.numbers[number] : field.known[field.codes[number]] ?? "";
      return row;
    });
  }

  function chart(id) {
    return init(at(id), null, { renderer: "canvas" });
  }

  function column(field) {
    const isNumber = Boolean(field.numbers);
    return {
      title: words(field), titleFormatter: plain, field: field.name, frozen: field.name === "test" && innerWidth > 700, sorter: isNumber ? "number" : "string",
      sorterParams: { alignEmptyValues: "bottom" }, hozAlign: isNumber ? "right" : "left", formatter: plain,
      headerFilter: "input", headerFilterFunc: matches, headerFilterPlaceholder: isNumber ? "< 0.1" : "text",
      // Test names differ in their last digits.
      minWidth: isNumber ? 84 : field.name === "test" ? 9 + 7.9 * Math.max(...field.known.map(name => name.length)) : 110,
    };
  }

  // Tabulator reads a string as HTML.
  function plain(cell) {
    return document.createTextNode(shown(cell.getValue()));
  }

  function words(field) {
    const [, name, unit] = /^(.*?)(?:_(s|m|mps))?$/.exec(field.name);
    const of = field.unit || { m: "m", s: "s", mps: "m/s" }[unit] || "";
    return name.replaceAll("_", " ").replace("ttc", "TTC").replace("adj ", "adj. ") + (of ? ` (${of})` : "");
  }

  function shown(value) {
    return value === null ? "" : typeof value !== "number" ? value : String(Number.isInteger(value) ? value : +value.toPrecision(4));
  }

  // `text`, `a | b`, `< 0.1`, `>= 40`, `= M 03`, `5 .. 10`
  function matches(term, value) {
    const parts = term.split("|").map(part => part.trim()).filter(Boolean);
    return !parts.length || parts.some(part => matchesOne(part, value));
  }

  // "5 %", "1,5" and, as this page writes thousands, "1,000" are numbers, too.
  function number(text) {
    return parseFloat(/^-?[1-9]\d{0,2}(,\d{3})+(?!\d)/.test(text) ? text.replaceAll(",", "") : text.replace(",", "."));
  }

  function matchesOne(term, value) {
    const range = /^(-?[\d.,]+)\s*%?\s*\.\.\s*(-?[\d.,]+)\s*%?$/.exec(term), comparison = /^(<=|>=|<|>|=)\s*(.+)$/.exec(term);
    if (range) return within(value, number(range[1]), number(range[2]));
    if (!comparison) return shown(value).toLowerCase().includes(term.toLowerCase());
    if (value === null) return false;
    const [, sign, text] = comparison, limit = number(text);
    if (typeof value !== "number") return sign === "=" && value.toLowerCase() === text.toLowerCase();
    return { "<": value < limit, "<=": value <= limit, ">": value > limit, ">=": value >= limit, "=": value === limit || shown(value) === text }[sign];
  }

  function within(value, low, high) {
    return value !== null && value !== "" && low <= value && value <= high;
  }

  function kept(filters) {
    return row => filters.every(({ field, value }) => matches(value, row[field]));
  }

  function brush(name, chooses) {
    if (chooses) brushed.set(name, chooses); else brushed.delete(name);
    if (brushed.size) table.setFilter(row => [...brushed.values()].every(chooses => chooses(row))); else table.clearFilter();
  }

  function reset() {
    area(false);
    brushed.clear();
    table.clearFilter();
    table.clearHeaderFilter();
    label();  // The fields are new ones.
    drawn = "[]";
    draw(rows);
  }

  function say(left) {
    const fails = rows.filter(failed).length.toLocaleString("en"), all = rows.length.toLocaleString("en");
    const found = left.filter(failed).length.toLocaleString("en");
    at("explorer-count").textContent = left.length === rows.length ? `${all} tests, ${fails} failures`
      : `${left.length.toLocaleString("en")} of ${all} tests, ${found} of ${fails} failures`;
  }

  function failed(row) {
    return row.end !== PASSED && row.end !== "error";
  }

  function ordinal(field, row) {
    if (field.numbers) return row[field.name];
    const place = categories(field).indexOf(row[field.name]);
    return place < 0 ? null : place;
  }

  // A row of a scenario without the variable has an empty text, which is no category.
  function categories(field) {
    return field.known.filter(Boolean);
  }

  function draw(left) {
    const ink = getComputedStyle(at("explorer")).color;
    const valid = left.filter(row => row.end !== "error"), failures = valid.filter(failed);
    const some = [...evenly(valid.filter(row => !failed(row)), Math.max(0, DRAWN - failures.length)), ...evenly(failures, DRAWN)];
    at("explorer-drawn").textContent = some.length < valid.length ? `The plots show ${some.length} of ${valid.length} tests, failures first.` : "";
    drawParallel(some, ink);
    drawScatter(some, ink);
  }

  function evenly(all, count) {
    return all.length <= count ? all : Array.from({ length: count }, (_, place) => all[Math.floor(place * all.length / count)]);
  }

  function drawParallel(some, ink) {
    const present = axes.filter(field => some.some(row => row[field.name] !== null && row[field.name] !== ""));
    parallel.setOption({
      animation: false, aria: { enabled: true }, textStyle: { color: ink },
      parallel: { left: 60, right: 60, top: 64, bottom: 24, parallelAxisDefault: { nameTextStyle: { color: ink, lineHeight: 14 }, axisLabel: { color: ink } } },
      parallelAxis: present.map((field, dim) => ({
        dim, id: field.name, name: words(field).replaceAll(" ", "\n"), nameLocation: "end", ...axis(field, ink),
        areaSelectStyle: { color: colours["contact"], opacity: 0.2, width: 18 },
      })),
      series: ends(some).map(([end, ended]) => ({
        type: "parallel", name: end, inactiveOpacity: 0.03, activeOpacity: end === PASSED ? 0.25 : 0.8,
        lineStyle: { color: colours[end], width: 1, opacity: end === PASSED ? 0.15 : 0.6 },
        data: ended.map(row => ({ row: row.number, value: present.map(field => row[field.name] === "" || row[field.name] === null ? "-" : row[field.name]) })),
      })),
    }, true);
    for (const field of axes) brushed.delete(field.name);
  }

  function axis(field, ink) {
    if (field.numbers) return { type: "value", min: field.low ?? 0, ...("high" in field ? { max: field.high } : {}) };
    return { type: "category", data: categories(field), axisLabel: { show: field.known.length <= FEW, color: ink } };
  }

  function drawScatter(some, ink) {
    scatter.setOption({
      animation: false, aria: { enabled: true }, textStyle: { color: ink }, brush: { xAxisIndex: 0, yAxisIndex: 0, throttleType: "debounce" },
      grid: { left: 56, right: 20, top: 30, bottom: 44 }, tooltip: { formatter: ({ value }) => value[3] },
      xAxis: { type: "value", name: "index of the test in its campaign", nameLocation: "middle", nameGap: 26, ...drawnIn(ink) },
      yAxis: { type: "value", name: "adj. TTC (s)", ...drawnIn(ink) },
      series: ends(some).map(([end, ended]) => ({
        type: "scatter", name: end, symbolSize: end === PASSED ? 4 : 7, itemStyle: { color: colours[end], opacity: end === PASSED ? 0.45 : 0.9 },
        data: ended.map(row => [row.index, row.adj_ttc_s, row.number, row.test]),
      })),
    }, true);
    brushed.delete("scatter");
    at("explorer-legend").replaceChildren(...ends(some).map(([end]) => badge(end)));
  }

  function drawnIn(ink) {
    return { axisLabel: { color: ink }, nameTextStyle: { color: ink }, splitLine: { lineStyle: { color: ink, opacity: 0.12 } } };
  }

  // Passed tests first, so that failures are drawn over them.
  function ends(some) {
    const order = [PASSED, ...Object.keys(colours).filter(end => end !== PASSED)];
    return order.map(end => [end, some.filter(row => row.end === end)]).filter(([, ended]) => ended.length);
  }

  function badge(end) {
    const shown = document.createElement("span"), dot = document.createElement("i");
    dot.style.background = colours[end];
    shown.append(dot, end);
    return shown;
  }

  function area(on) {
    at("explorer-area").setAttribute("aria-pressed", String(on));
    scatter.dispatchAction({ type: "takeGlobalCursor", key: "brush", brushOption: { brushType: on ? "rect" : false, brushMode: "single" } });
    if (!on) { scatter.dispatchAction({ type: "brush", areas: [] }); brush("scatter", null); }
  }

  function label() {
    for (const input of document.querySelectorAll("#explorer-table input")) {
      const title = input.closest(".tabulator-col").querySelector(".tabulator-col-title");
      input.setAttribute("aria-label", `Filter ${title.textContent}`);
      Object.assign(title, { tabIndex: 0, role: "button", onkeydown: event => { if (event.key === "Enter") title.click(); } });
    }
  }

  function reachable(row) {
    const element = row.getElement();
    element.tabIndex = 0;
    element.onkeydown = event => {
      if (event.key !== "Enter") return;
      choose(row.getData());
      at("explorer-one").querySelector(".copy").focus();
    };
  }

  function choose(row) {
    at("explorer-one").hidden = false;
    at("explorer-title").textContent = `${row.test}: ${row.end}`;
    at("explorer-command").textContent = `python -m pipeline replay ${row.test}`;
    at("explorer-view").replaceChildren(...view(row));
    at("explorer-values").replaceChildren(...fields.slice(1).flatMap(field => pair(words(field), shown(row[field.name]))));
    at("explorer-one").scrollIntoView({ block: "nearest" });
  }

  function view(row) {
    const film = at(`film-${row.test}`), image = thumbnails[row.test];
    asking.abort();
    if (film) return [playing(row, film.src, film.poster)];
    const said = document.createElement("p"), picture = image ? [document.createElement("img")] : [];
    for (const one of picture) Object.assign(one, { src: image, alt: `A moment of test ${row.test}` });
    said.setAttribute("role", "status");
    if (row.end === "error") said.textContent = "This test ended in an error, so it has no film.";
    else if (served) ask(row, said);
    else if (!image) said.textContent = "This test has no picture here. The command above makes its film.";
    return [...picture, said];
  }

  function playing(row, src, poster = "") {
    const shown = document.createElement("video");
    return Object.assign(shown, { src, poster, controls: true, loop: true, muted: true, autoplay: true, ariaLabel: `Film of test ${row.test}` });
  }

  // A page that goes on to another test hangs up, so that its film is not made in vain.
  async function ask(row, said) {
    asking = new AbortController();
    said.textContent = "The film of this test is being made; this takes a few seconds.";
    try {
      const answer = await fetch(`/films/${row.test}.mp4`, { signal: asking.signal });
      const body = await (answer.ok ? answer.blob() : answer.text());
      if (!answer.ok) { said.textContent = body; return; }
      URL.revokeObjectURL(fetched);
      fetched = URL.createObjectURL(body);
      said.textContent = decodeURIComponent(answer.headers.get("X-Changed") ?? "");
      at("explorer-view").replaceChildren(playing(row, fetched), said);
    } catch (error) {
      if (error.name !== "AbortError") said.textContent = "The server does not answer. Start it again with ./run explore";
    }
  }

  function pair(name, value) {
    if (value === "") return [];
    const term = document.createElement("dt"), text = document.createElement("dd");
    [term.textContent, text.textContent] = [name, value];
    return [term, text];
  }

  // Two films that play at the same time, again and again; the shorter one waits on its last picture.
  function together(films) {
    const ended = () => films.every(film => film.ended);
    for (const film of films) {
      film.onplay = () => films.forEach(other => { if (other.paused && !other.ended) other.play().catch(() => {}); });
      film.onpause = () => { if (!film.ended) films.forEach(other => other.pause()); };
      // Seen side by side, they show the same moment.
      film.ontimeupdate = () => films.forEach(other => {
        if (!film.ended && !other.ended && film.currentTime - other.currentTime > 0.15) film.currentTime = other.currentTime;
      });
      film.onended = () => setTimeout(() => { if (ended()) films.forEach(other => { other.currentTime = 0; other.play().catch(() => {}); }); }, 1500);
    }
    if (!matchMedia("(prefers-reduced-motion: reduce)").matches) films[0]?.play().catch(() => {});
  }

  // A click anywhere on a region's card, but not on its other controls and not to select its text.
  function showRegion(card, clicked) {
    const button = clicked.closest("button, video, summary, a");
    if (button ? !button.matches(".show") : String(getSelection())) return;
    reset();
    table.setHeaderFilterValue("region", `= ${card.dataset.region}`);
    label();
    at("explorer-count").tabIndex = -1;
    at("explorer-count").focus({ preventScroll: true });
    at("explorer-count").scrollIntoView({ block: "center" });
  }

  async function copy(button) {
    const command = button.previousElementSibling;
    try {
      await navigator.clipboard.writeText(command.textContent);
      button.textContent = "Copied";
    } catch {
      getSelection().selectAllChildren(command);
      button.textContent = "Press Ctrl-C";
    }
    setTimeout(() => { button.textContent = "Copy"; }, 1500);
  }
})();
