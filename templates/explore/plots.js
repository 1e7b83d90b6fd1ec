/* The four pictures, drawn with Plotly from what /api/picture gives. Colours of lines and text come from the style sheet; those
   of the map are the report's, and come with the data. */
"use strict";

const plots = (() => {
  const MAPS = {
    yaw_rate: { title: "Yaw rate", unit: "deg/s", symmetric: false },
    sideslip: { title: "Sideslip angle", unit: "deg", symmetric: true },
    rear_angle: { title: "Rear angle", unit: "deg", symmetric: true },
  };
  const CONFIG = { responsive: true, displaylogo: false, displayModeBar: false, scrollZoom: false };

  /* Asked for once in each theme: between pictures the browser would work out the styles of the whole page again. */
  let colours = {};
  const colour = (name) => (colours[name] ??= getComputedStyle(document.documentElement).getPropertyValue(`--${name}`).trim());
  const recolour = () => { colours = {}; };

  /* Rows of a packed table. */
  function unpacked(table) {
    const text = atob(table.bdata);
    const bytes = new Uint8Array(text.length);
    for (let place = 0; place < text.length; place++) bytes[place] = text.charCodeAt(place);
    const values = table.dtype === "f4" ? new Float32Array(bytes.buffer) : bytes;
    const [rows, columns] = table.shape.split(",").map(Number);
    return Array.from({ length: rows }, (_, row) => values.subarray(row * columns, (row + 1) * columns));
  }

  function line(x, y, name, look, more) {
    const looks = {
      now: { color: colour("now"), width: 3 },
      begun: { color: colour("begun"), width: 2 },
      family: { color: colour("now"), width: 1.5, dash: "5px,3px" },
      passive: { color: colour("passive"), width: 2, dash: "8px,4px" },
      reference: { color: colour("reference"), width: 2, dash: "2px,3px" },
      limit: { color: colour("limit"), width: 1.5, dash: "10px,3px,2px,3px" },
    };
    return { type: "scatter", mode: "lines", x, y, name, line: looks[look], ...more };
  }

  function axis(title, more) {
    return {
      title: { text: title, standoff: 6 }, gridcolor: colour("grid"), linecolor: colour("muted"), zerolinecolor: colour("line"),
      tickcolor: colour("muted"), ticks: "outside", ticklen: 4, tickangle: 0, ticklabeloverflow: "allow", ...more,
    };
  }

  function layout(more) {
    return {
      paper_bgcolor: "rgba(0,0,0,0)", plot_bgcolor: "rgba(0,0,0,0)", showlegend: false, uirevision: "kept",
      font: { color: colour("ink"), size: 12, family: "system-ui, 'Segoe UI', 'Noto Sans', 'DejaVu Sans', sans-serif" },
      hoverlabel: { bgcolor: colour("ground"), bordercolor: colour("muted"), font: { color: colour("ink") } },
      margin: { l: 50, r: 12, t: 26, b: 44 }, hovermode: "x", ...more,
    };
  }

  /* Panels above each other on one axis of x; each has its title above it. */
  function stacked(titles, xTitle, more) {
    const height = 1 / titles.length;
    const parts = { xaxis: axis(xTitle, { anchor: titles.length > 1 ? `y${titles.length}` : "y" }), annotations: [] };
    titles.forEach((text, index) => {
      const top = 1 - index * height;
      const gap = index === titles.length - 1 ? 0 : 0.09;
      parts[index ? `yaxis${index + 1}` : "yaxis"] = axis("", { domain: [top - height + gap, top] });
      parts.annotations.push({
        text: `<b>${text}</b>`, xref: "paper", yref: "paper", x: 0, y: top, xanchor: "left", yanchor: "bottom", yshift: 2, showarrow: false,
      });
    });
    return layout({ ...parts, ...more });
  }

  /* The largest magnitude, rounded up, so that the colours stay while a slider moves a little. */
  function reach(rows) {
    let largest = 0;
    for (const row of rows) for (const value of row) if (Math.abs(value) > largest) largest = Math.abs(value);
    if (!(largest > 1e-3)) return 1;
    const step = 10 ** Math.floor(Math.log10(largest)) / 2;
    return Math.ceil(largest / step - 1e-6) * step;
  }

  function heat(map, quantity, scales) {
    const base = { type: "heatmap", x: map.speed_km_h, y: map.front_angle_deg, zsmooth: false, hoverongaps: false };
    const bar = { thickness: 12, outlinewidth: 0, tickfont: { color: colour("ink") } };
    if (quantity === "binding") {
      const names = map.binding_names;
      const count = names.length;
      const shown = map.binding_colours;
      const z = map.binding.map((row) => Array.from(row, (index) => (index === 255 ? null : index)));
      const text = z.map((row) => row.map((index) => (index === null ? "" : names[index])));
      const colorscale = names.flatMap((_, index) => [[index / count, shown[index]], [(index + 1) / count, shown[index]]]);
      return {
        ...base, z, text, colorscale, zmin: -0.5, zmax: count - 0.5, showscale: false,
        hovertemplate: "%{x:.0f} km/h, %{y:.1f} deg<br>%{text}<extra></extra>",
      };
    }
    const look = MAPS[quantity];
    const most = reach(map[quantity]);
    return {
      ...base, z: map[quantity], colorscale: scales[quantity], zmin: look.symmetric ? -most : 0, zmax: most, colorbar: bar,
      hovertemplate: `%{x:.0f} km/h, %{y:.1f} deg<br>%{z:.2f} ${look.unit}<extra></extra>`,
    };
  }

  /* Squares for the colours of a map of names. */
  function patches(names, shown) {
    return names.map((name, index) => ({
      type: "scatter", mode: "markers", x: [null], y: [null], name, showlegend: true, hoverinfo: "skip",
      marker: { symbol: "square", size: 11, color: shown[index], line: { color: colour("muted"), width: 1 } },
    }));
  }

  /* scales: table -> its colours, as Plotly takes them. */
  function drawMap(target, data, quantity, scales) {
    const map = data.map;
    const traces = [heat(map, quantity, scales)];
    for (const [x, y] of map.phase_lines) {
      traces.push({ type: "scatter", mode: "lines", x, y, hoverinfo: "skip", showlegend: false, line: { color: "#ffffff", width: 5 }, name: "" });
      traces.push({ type: "scatter", mode: "lines", x, y, hoverinfo: "skip", showlegend: false, line: { color: "#000000", width: 2 }, name: "phase conversion" });
    }
    traces.push({
      type: "scatter", mode: "markers", x: [data.cut.speed_km_h], y: [data.cut.front_angle_deg], name: "the step", hoverinfo: "skip", showlegend: false,
      marker: { symbol: "circle-open-dot", size: 13, color: "#000000", line: { width: 3, color: "#ffffff" } },
    });
    const names = quantity === "binding" ? map.binding_names : [];
    traces.push(...patches(names, map.binding_colours));
    const speed = data.cut.speed_km_h;
    const look = MAPS[quantity];
    const ends = (values) => [values[0], values[values.length - 1]];
    return Plotly.react(target, traces, layout({
      xaxis: axis("Speed (km/h)", { range: ends(map.speed_km_h), showgrid: false, zeroline: false }),
      yaxis: axis("Front angle (deg)", { range: ends(map.front_angle_deg), showgrid: false, zeroline: false }),
      plot_bgcolor: colour("empty"), hovermode: "closest",
      showlegend: names.length > 0, legend: { orientation: "h", x: 0, y: 1.01, xanchor: "left", yanchor: "bottom" },
      annotations: look ? [{
        text: `<b>${look.title} (${look.unit})</b>`, xref: "paper", yref: "paper", x: 0, y: 1, xanchor: "left", yanchor: "bottom", yshift: 2, showarrow: false,
      }] : [],
      shapes: [{ type: "line", x0: speed, x1: speed, yref: "paper", y0: 0, y1: 1, line: { color: names.length ? "#000000" : "#ffffff", width: 1.5, dash: "3px,3px" } }],
    }), CONFIG);
  }

  function drawCut(target, data) {
    const { now, start } = data.cut;
    const at = data.cut.front_angle_deg;
    const traces = [];
    for (const [name, curves, look] of [["at the start", start, "begun"], ["these settings", now, "now"]]) {
      traces.push(line(curves.front_angle_deg, curves.yaw_rate_deg_s, name, look));
      traces.push(line(curves.front_angle_deg, curves.rear_angle_deg, name, look, { yaxis: "y2" }));
    }
    return Plotly.react(target, traces, stacked(["Yaw rate (deg/s)", "Rear angle (deg)"], "Front angle (deg)", {
      shapes: [{ type: "line", x0: at, x1: at, yref: "paper", y0: 0, y1: 1, line: { color: colour("muted"), width: 1, dash: "3px,3px" } }],
    }), CONFIG);
  }

  function drawStep(target, data) {
    const { time_s: time, runs, rear_angle_max_deg: most } = data.step;
    const ends = [time[0], time[time.length - 1]];
    const end = settled(time, runs);
    const window = [-0.05 * end, end];
    const traces = [line(time, runs.now.reference_deg_s, "reference", "reference")];
    const shown = [["passive car", runs.passive, "passive"], ["at the start", runs.start, "begun"], ["these settings", runs.now, "now"]];
    for (const [name, curves, look] of shown) {
      traces.push(line(time, curves.yaw_rate_deg_s, name, look));
      traces.push(line(time, curves.sideslip_deg, name, look, { yaxis: "y2" }));
      if (look !== "passive") traces.push(line(time, curves.rear_angle_deg, name, look, { yaxis: "y3" }));
    }
    for (const bound of [most, -most]) traces.push(line(ends, [bound, bound], "limit", "limit", { yaxis: "y3", hoverinfo: "skip" }));
    const shape = stacked(["Yaw rate (deg/s)", "Sideslip angle (deg)", "Rear angle (deg)"], "Time after the step (s)", {});
    shape.xaxis.range = window;
    return Plotly.react(target, traces, shape, CONFIG);
  }

  /* The time after which no curve leaves 2 % of its last value any more, and a quarter more: the transient fills the chart. */
  function settled(time, runs) {
    let last = 0;
    for (const curves of Object.values(runs)) {
      for (const values of [curves.yaw_rate_deg_s, curves.sideslip_deg, curves.rear_angle_deg]) {
        const end = values[values.length - 1];
        const band = 0.02 * Math.max(...values.map((value) => Math.abs(value)), 0.05);
        for (let k = values.length - 1; k > last; k--) {
          if (!(Math.abs(values[k] - end) <= band)) { last = k; break; }
        }
      }
    }
    return Math.min(Math.max(1.25 * time[last], 0.5), time[time.length - 1]);
  }

  function drawMargins(target, data) {
    if (!data.margins) return Promise.resolve();
    const { now, start } = data.margins;
    const ends = [now.speed_km_h[0], now.speed_km_h[now.speed_km_h.length - 1]];
    const traces = [];
    for (const [name, curves, look] of [["at the start", start, "begun"], ["these settings", now, "now"]]) {
      traces.push(line(curves.speed_km_h, curves.gain_db, name, look));
      traces.push(line(curves.speed_km_h, curves.phase_deg, name, look, { yaxis: "y2" }));
    }
    const { family } = data.margins;
    if (family) {
      traces.push(line(family.speed_km_h, family.gain_db, "worst of the family", "family"));
      traces.push(line(family.speed_km_h, family.phase_deg, "worst of the family", "family", { yaxis: "y2" }));
    }
    traces.push(line(ends, [now.asked_gain_db, now.asked_gain_db], "required", "limit"));
    traces.push(line(ends, [now.asked_phase_deg, now.asked_phase_deg], "required", "limit", { yaxis: "y2" }));
    const shape = stacked(["Gain margin (dB)", "Phase margin (deg)"], "Speed (km/h)", {});
    shape.yaxis.rangemode = "tozero";
    shape.yaxis2.rangemode = "tozero";
    return Plotly.react(target, traces, shape, CONFIG);
  }

  return { drawMap, drawCut, drawStep, drawMargins, recolour, unpacked };
})();
