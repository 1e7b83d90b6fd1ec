/* Settings in, pictures out. One request is under way at a time; what moves meanwhile goes with the next, the last value wins. */
"use strict";

(() => {
  const start = JSON.parse(document.getElementById("start").textContent);
  const element = (id) => document.getElementById(id);
  const status = element("status");
  const controls = new Map();
  let picture = null;
  let drawn = {};
  let waiting = 0;
  let wanted = 0;
  let working = false;
  let since = 0;

  const FAMILY_AFTER_MS = 300;

  /* --- settings ------------------------------------------------------------------------------------------------ */

  const rounded = (value, digits) => Number(value.toPrecision(digits));
  const shown = (value) => String(rounded(value, 6));

  class Setting {
    constructor(spec, box) {
      this.spec = spec;
      this.box = box;
      this.zero = spec.logarithmic && spec.bounds[0] === 0 ? 1 : 0; // stops below the lowest ratio
      this.number = box.querySelector("input[type=number]");
      this.slider = box.querySelector("input[type=range]");
      this.was = box.querySelector(".was");
      if (spec.logarithmic) {
        this.slider.min = 0;
        this.slider.max = this.zero + Math.round(Math.log(spec.high / spec.low) / Math.log1p(spec.step));
        this.slider.step = 1;
      } else {
        this.slider.min = spec.low;
        this.slider.max = spec.high;
        this.slider.step = spec.step;
      }
      this.number.addEventListener("input", () => this.typed());
      this.slider.addEventListener("input", () => this.set(this.fromSlider(), "slider"));
      this.set(spec.value, "start");
    }

    fromSlider() {
      const place = Number(this.slider.value);
      if (!this.spec.logarithmic) return rounded(place, 10);
      return place < this.zero ? 0 : rounded(this.spec.low * (1 + this.spec.step) ** (place - this.zero), 3);
    }

    toSlider(value) {
      if (!this.spec.logarithmic) return value;
      if (value === 0) return 0;
      return this.zero + Math.log(Math.max(value, this.spec.low) / this.spec.low) / Math.log1p(this.spec.step);
    }

    typed() {
      if (this.number.value !== "" && this.number.checkValidity()) {
        this.set(Number(this.number.value), "number");
      } else {
        const [least, most] = this.spec.bounds;
        showStatus(`${this.spec.label}: give a number from ${least} to ${most} ${this.spec.unit}`, true);
        element("reset").disabled = false;
      }
    }

    set(value, from) {
      this.value = value;
      if (from !== "number") this.number.value = shown(value);
      if (from !== "slider") this.slider.value = this.toSlider(value);
      this.slider.setAttribute("aria-valuetext", `${shown(value)} ${this.spec.unit}`);
      const changed = value !== this.spec.value;
      this.box.classList.toggle("changed", changed);
      this.was.textContent = changed ? ` · was ${shown(this.spec.value)}` : "";
      if (from !== "start") changedSettings();
    }
  }

  function values() {
    return Object.fromEntries([...controls].map(([key, setting]) => [key, setting.value]));
  }

  function changedSettings() {
    element("reset").disabled = ![...controls.values()].some((setting) => setting.value !== setting.spec.value);
    wanted++;
    element("pictures").dataset.wanted = String(wanted);
    since = performance.now();
    clearTimeout(waiting);
    if (!working) work();
  }

  /* --- asking and drawing ---------------------------------------------------------------------------------------- */

  async function post(address, body) {
    const answer = await fetch(address, {
      method: "POST",
      headers: { "Content-Type": "application/json", "X-Explore-Key": start.key },
      body: JSON.stringify(body),
    });
    return { ok: answer.ok, status: answer.status, data: await answer.json() };
  }

  async function work() {
    working = true;
    let done = -1;
    let isShown = false;
    while (done !== wanted) {
      done = wanted;
      isShown = false;
      const began = since;
      try {
        const answer = await post("/api/picture", { page: start.page, number: done, values: values() });
        if (!answer.ok) {
          showStatus(`${answer.data.error}. The charts still show the previous settings.`, true);
        } else if (!answer.data.stale) {
          await show(answer.data, began);
          isShown = true;
        }
      } catch (problem) {
        showStatus(`The explorer does not answer: is \`codegen explore\` still running? (${problem.message})`, true);
      }
    }
    working = false;
    if (isShown) waiting = setTimeout(askFamily, FAMILY_AFTER_MS);
  }

  /* The whole family of cars takes longer than one: it comes when the settings rest, and only where their pictures are shown. */
  async function askFamily() {
    if (!picture || !picture.margins) return;
    const requested = wanted;
    try {
      const { ok, data } = await post("/api/family", { page: start.page, number: requested, values: values() });
      if (!ok || data.stale || requested !== wanted) return;
      picture.margins.family = data;
      await draw();
      const took = element("took").textContent;
      warn([...picture.warnings, ...data.warnings], data.stable);
      element("took").textContent = took;
      element("margins").dataset.family = String(requested);
    } catch (problem) {
      showStatus(`The explorer does not answer: is \`codegen explore\` still running? (${problem.message})`, true);
    }
  }

  const TABLES = ["yaw_rate", "sideslip", "rear_angle", "binding"];

  async function show(data, began) {
    data.map.identity = TABLES.map((name) => data.map[name].bdata).join();
    for (const name of TABLES) data.map[name] = plots.unpacked(data.map[name]);
    picture = data;
    await draw();
    const took = Math.round(performance.now() - began);
    const server = Math.round(Object.values(data.took_ms).reduce((sum, part) => sum + part, 0));
    warn(data.warnings, true);
    element("took").textContent = `${took} ms from the change to the picture, ${server} ms of them computing.`;
    document.dispatchEvent(new CustomEvent("explorer-drawn", { detail: { took, server } }));
    element("pictures").dataset.drawn = String(Number(element("pictures").dataset.drawn || 0) + 1);
  }

  function draw() {
    const data = picture;
    element("cut-title").textContent = `Cut through the map at ${shown(data.cut.speed_km_h)} km/h`;
    element("cut-caption").textContent =
      `As the controller looks it up. The dashed line is the step's front angle, ${rounded(data.cut.front_angle_deg, 3)} deg.`;
    element("map-reading").textContent = summary(data.map);
    element("margins-caption").textContent = marginText(data.margins);
    fillFigures(data);
    fillJudgement(data.judgement);
    const quantity = element("quantity").value;
    const { map, cut, step, margins } = data;
    const stepPlace = [cut.speed_km_h, cut.front_angle_deg];
    return Promise.all([
      redraw("map", [map.identity, map.binding_names, stepPlace, quantity], (target) => plots.drawMap(target, data, quantity, start.scales)),
      redraw("step", step, (target) => plots.drawStep(target, data)),
      redraw("cut", cut, (target) => plots.drawCut(target, data)),
      redraw("margins", margins, (target) => plots.drawMargins(target, data)),
    ]);
  }

  /* A picture that would look as it does is left alone. */
  function redraw(name, from, drawing) {
    const text = JSON.stringify([from, isDark()]);
    if (drawn[name] === text) return Promise.resolve();
    drawn[name] = text;
    return drawing(element(name));
  }

  function summary(map) {
    const line = map.phase_lines.length ? " Black line: phase conversion, where the rear angle is zero." : "";
    return `${map.feasible_percent} % of the cells have a steady turn inside the limits; grey ones have none.${line} Circle: the step.`;
  }

  function marginText(margins) {
    if (!margins) return "This law has no feedback and therefore no margins.";
    const { now } = margins;
    const unstable = now.worst.stable ? "" : " UNSTABLE at some of these speeds.";
    const family = margins.family ? ` (${margins.family.cars}, up to ${rounded(margins.family.speed_km_h.at(-1), 4)} km/h)` : "";
    const required = `Required for all cars of the family${family}: ${now.asked_gain_db} dB and ${now.asked_phase_deg} deg.`;
    const ends = `Larger or infinite margins are drawn at ${now.drawn_to_gain_db} dB and ${now.drawn_to_phase_deg} deg.`;
    return `Thick line: the configured car. ${required} ${ends}${unstable}`;
  }

  const FIGURES = [
    ["overshoot_percent", "Overshoot of the yaw rate", "%"],
    ["rise_time_s", "Rise time to 90 %", "s"],
    ["yaw_rate_steady_deg_s", "Yaw rate, steady", "deg/s"],
    ["sideslip_peak_deg", "|Sideslip angle|, peak", "deg"],
    ["rear_angle_peak_deg", "|Rear angle|, peak", "deg"],
    ["lateral_acceleration_m_s2", "|Lateral acceleration|, peak", "m/s²"],
  ];

  function row(title, cells) {
    const line = document.createElement("tr");
    const head = line.appendChild(document.createElement("th"));
    head.scope = "row";
    head.textContent = title;
    for (const text of cells) {
      const cell = line.appendChild(document.createElement("td"));
      cell.className = "number";
      cell.textContent = text;
    }
    return line;
  }

  function fillFigures(data) {
    const found = data.step.figures;
    const runs = ["now", "start", "passive"];
    const text = (run, key) => (found[run].spins ? "spins" : found[run][key] === null ? "–" : String(rounded(found[run][key], 4)));
    const rows = FIGURES.map(([key, title, unit]) => row(`${title} (${unit})`, runs.map((run) => text(run, key))));
    const ended = (run) => (found[run].spins ? "spins" : found[run].settled ? "yes" : "no");
    rows.unshift(row("Settled at the end", runs.map(ended)));
    if (data.margins) {
      const worst = (side, key, at) => {
        const value = data.margins[side].worst[key];
        return value === null ? "no limit" : `${rounded(value, 3)} at ${rounded(data.margins[side].worst[at], 4)} km/h`;
      };
      for (const [key, at, title] of [["gain_db", "gain_at_km_h", "Smallest gain margin, configured car (dB)"], ["phase_deg", "phase_at_km_h", "Smallest phase margin, configured car (deg)"]]) {
        rows.push(row(title, [worst("now", key, at), worst("start", key, at), "–"]));
      }
    }
    if (data.margins && data.margins.family) {
      const { family } = data.margins;
      for (const [key, title] of [["gain_db", "Smallest gain margin, family of cars (dB)"], ["phase_deg", "Smallest phase margin, family of cars (deg)"]]) {
        const at = family[key].indexOf(Math.min(...family[key]));
        rows.push(row(title, [`${rounded(family[key][at], 3)} at ${rounded(family.speed_km_h[at], 4)} km/h`, "–", "–"]));
      }
    }
    element("figures").replaceChildren(...rows);
  }

  /* The judgement that codegen tune stored in the map. It is valid until a setting moves. */
  function fillJudgement(judgement) {
    element("judgement").dataset.state = judgement.state;
    element("judgement-sentence").textContent = judgement.sentence;
    element("judgement-details").hidden = judgement.rows.length === 0;
    element("judgement-header").replaceChildren(...judgement.header.map((text) => {
      const head = document.createElement("th");
      head.scope = "col";
      head.textContent = text;
      return head;
    }));
    element("judgement-rows").replaceChildren(...judgement.rows.map(([title, ...cells]) => {
      const line = row(title, cells);
      line.querySelectorAll("td").forEach((cell, at) => cell.classList.toggle("number", at < 2));
      return line;
    }));
  }

  /* Unstable settings are no configuration to keep: they cannot be written. */
  function warn(texts, isStable) {
    const list = element("warnings");
    list.replaceChildren(...texts.map((text) => {
      const item = document.createElement("li");
      item.textContent = text;
      return item;
    }));
    list.hidden = texts.length === 0;
    element("write").disabled = !isStable;
    const unstable = isStable ? "" : " A car of the family is unstable with these gains: they are not written.";
    showStatus(texts.length ? `Up to date, with ${texts.length === 1 ? "a warning" : `${texts.length} warnings`}.${unstable}` : "Up to date.", false);
  }

  /* Screen readers read the status aloud: an unchanged text is not set again, and times are in another element. */
  function showStatus(text, bad) {
    const shown = (bad ? "⚠ " : "") + text;
    if (status.textContent !== shown) status.textContent = shown;
    element("took").textContent = "";
    status.classList.toggle("bad", bad);
  }

  /* --- writing the file ------------------------------------------------------------------------------------------ */

  async function write(replaces) {
    try {
      const { ok, status: code, data } = await post("/api/write", { values: values(), replaces });
      if (ok) return showStatus(`${data.file} is written. Next: ${data.next}`, false);
      if (code === 409 && data.sha256) return confirmReplacing(data);
      return showStatus(data.error, true);
    } catch (problem) {
      return showStatus(`Nothing is written: the explorer does not answer (${problem.message}).`, true);
    }
  }

  function confirmReplacing(data) {
    const dialog = element("confirm");
    element("confirm-text").textContent = data.text;
    element("confirm-changes").replaceChildren(...data.changes.map((text) => {
      const item = document.createElement("li");
      item.textContent = text;
      return item;
    }));
    element("cancel").onclick = () => {
      dialog.close();
      showStatus(`${start.file} is unchanged.`, false);
    };
    element("replace").onclick = () => {
      dialog.close();
      write(data.sha256);
    };
    dialog.showModal();
  }

  /* --- light and dark -------------------------------------------------------------------------------------------- */

  const system = matchMedia("(prefers-color-scheme: dark)");
  const isDark = () => (document.documentElement.dataset.theme || (system.matches ? "dark" : "light")) === "dark";

  function nameTheme() {
    element("theme").textContent = isDark() ? "Light" : "Dark";
    element("theme").setAttribute("aria-label", isDark() ? "Light colours" : "Dark colours");
    plots.recolour();
    if (picture) draw();
  }

  element("theme").addEventListener("click", () => {
    document.documentElement.dataset.theme = isDark() ? "light" : "dark";
    nameTheme();
  });
  system.addEventListener("change", nameTheme);

  /* --- the beginning --------------------------------------------------------------------------------------------- */

  for (const spec of start.controls) controls.set(spec.key, new Setting(spec, document.querySelector(`[data-key="${spec.key}"]`)));
  element("controls").addEventListener("submit", (event) => event.preventDefault());
  element("quantity").addEventListener("change", () => picture && draw());
  element("write").addEventListener("click", () => write(null));
  element("reset").addEventListener("click", () => {
    for (const setting of controls.values()) {
      const isTyped = setting.number.value !== shown(setting.spec.value); // also what is no number
      if (setting.value !== setting.spec.value || isTyped) setting.set(setting.spec.value, "reset");
    }
  });
  nameTheme();
  changedSettings();
})();
