"use strict";
let review = JSON.parse(document.getElementById("data").textContent);

// ---- numbers and markup

function escape(text) {
  return String(text).replace(/[&<>"]/g, (c) => ({ "&": "&amp;", "<": "&lt;", ">": "&gt;", '"': "&quot;" })[c]);
}

/// A text of our own, in markup: σ_max and K_a with subscripts.
function rich(text) {
  return escape(text).replace(/(σ|\b[A-Z])_(max|[A-Za-z])\b/g, "$1<sub>$2</sub>");
}

function fixed(x, digits = 1) {
  return x === null || x === undefined || !Number.isFinite(x) ? "–" : x.toFixed(digits).replace("-", "−");
}

function short(x, digits = 4) {
  if (x === null || x === undefined || !Number.isFinite(x)) return "–";
  if (x === 0) return "0";
  const size = Math.abs(x);
  const text = size >= 1e5 || size < 1e-3 ? x.toExponential(digits - 1) : String(Number(x.toPrecision(digits)));
  return text.replaceAll("-", "−").replace("e+", "e");
}

/// Rows of cells; a cell that is no number is text. `texts` columns stand on the left. Rows that
/// `differs` accepts are marked.
function table(head, rows, texts = 1, differs = () => false) {
  const cell = (tag) => (value, i) => `<${tag}${i < texts ? ' class="text"' : ""}>${value}</${tag}>`;
  const body = rows.map((row) => `<tr${differs(row) ? ' class="differs"' : ""}>${row.map(cell("td")).join("")}</tr>`).join("");
  return `<div class="scroll"><table><thead><tr>${head.map(cell("th")).join("")}</tr></thead><tbody>${body}</tbody></table></div>`;
}

/// A matrix, its entries shaded by size.
function matrix(title, rows, across, down) {
  const largest = Math.max(...rows.flat().map(Math.abs)) || 1;
  const shade = (x) => `rgba(${x < 0 ? "213,94,0" : "0,114,178"},${(0.5 * Math.abs(x)) / largest})`;
  // What rounding leaves of a zero.
  const cell = (x) => `<td style="background:${shade(x)}">${Math.abs(x) < 1e-9 * largest ? "0" : short(x, 5)}</td>`;
  const head = across ? `<tr><th></th>${across.map((n) => `<th>${escape(n)}</th>`).join("")}</tr>` : "";
  const line = (row, i) => `<tr><th class="text">${escape(down ? down[i] : i + 1)}</th>${row.map(cell).join("")}</tr>`;
  return `<div><h3>${rich(title)}</h3><div class="scroll"><table class="matrix">${head}${rows.map(line).join("")}</table></div></div>`;
}

function bars(title, shares) {
  const line = ({ name, share }) => `<div class="bar"><span>${escape(name)}</span><div><i style="width:${100 * share}%"></i></div><span>${fixed(100 * share, 1)} %</span></div>`;
  return `<h3>${title}</h3>${shares.map(line).join("")}`;
}

function swatch(colour, text) {
  return `<span><i style="background:${colour}"></i>${text}</span>`;
}

function from_to(list) {
  return list.length > 1 ? `${fixed(Math.min(...list), 1)} to ${fixed(Math.max(...list), 1)} Hz` : `${fixed(list[0], 1)} Hz`;
}

// ---- charts

function colour(series) {
  return `rgba(${series.colour},${series.style === "limit" ? 0.7 : 1})`;
}

function trace(series, chart) {
  const dash = { line: "solid", dashed: "dash", limit: "dot", points: "solid" }[series.style];
  const points = series.style === "points";
  const name = rich(series.name);
  return {
    name, x: series.x, y: series.y, type: "scatter",
    mode: points ? "markers" : "lines",
    line: { color: colour(series), width: series.style === "limit" ? 1.2 : 2, dash },
    marker: { color: colour(series), size: 10, opacity: 0.8 },
    visible: series.shown ? true : "legendonly",
    showlegend: !names_at_axis(chart) && !(series.style === "limit" && series.shown && chart.x.scale !== "equal"),
    text: series.labels.map(escape),
    hovertemplate: series.labels.length ? `${name}<br>%{text}<extra></extra>`
      : `${name}<br>${rich(chart.x.label)} %{x:.4g}<br>${rich(chart.y.label)} %{y:.4g}<extra></extra>`,
  };
}

/// Whether the rows of the vertical axis tell what each set of points is.
function names_at_axis(chart) {
  return chart.y.names.length > 1;
}

/// Lowest and highest number on an axis as it is drawn at first.
function span(chart, key) {
  const shown = chart.series.filter((s) => s.shown).flatMap((s) => s[key]);
  const seen = chart[key].scale === "log" ? shown.filter((x) => x > 0) : shown;
  return chart[key].range ?? [-largest(seen.map((x) => -x)), largest(seen)];
}

/// The axis `key`, "x" or "y", of a chart, `length` pixels long. The ticks of one axis have one
/// notation: decimal, or powers of ten.
function axis(chart, key, length) {
  const from = chart[key];
  const log = from.scale === "log";
  const [low, high] = span(chart, key);
  const decades = log ? Math.log10(high / low) : 0;
  const plain = !log || (low > 4e-4 && high < 5e5);
  // 0.1, 0.2, 0.5, 1 where there is room, or else whole decades.
  const room = length / decades;
  const coarse = { dtick: Math.ceil((key === "x" ? 40 : 26) / room) };
  const ticks = !log ? {} : plain && room > (key === "x" ? 150 : 90) ? { dtick: "D2" } : coarse;
  return {
    title: { text: rich(from.label) }, type: log ? "log" : "linear",
    range: from.range ? from.range.map((x) => (log ? Math.log10(x) : x)) : undefined,
    gridcolor: "#e4e8eb", zeroline: false, ticks: "outside", tickangle: 0, tickcolor: "#9aa5ad", automargin: true, exponentformat: "power",
    ...ticks, ...(log && plain ? { tickformat: "~f" } : {}),
    ...(from.names.length ? { tickvals: from.names.map((_, i) => i), ticktext: from.names.map(rich) } : {}),
  };
}

function chart(c) {
  return `<figure><h3>${rich(c.title)}</h3><p class="note">${rich(c.note)} ${rich(c.styles)}</p><div class="chart${c.x.scale === "equal" ? " square" : ""}" data-chart="${c.id}"></div></figure>`;
}

/// The names of limits, at their right ends.
function limits(c) {
  const place = (from, x) => (from.scale === "log" ? Math.log10(x) : x);
  const own = c.series.filter((s) => s.style === "limit" && s.shown && c.x.scale !== "equal");
  return own.map((s) => ({
    x: place(c.x, s.x[s.x.length - 1]), y: place(c.y, s.y[s.y.length - 1]), text: rich(s.name),
    showarrow: false, xanchor: "right", yanchor: "bottom", borderpad: 0, font: { size: 10 },
  }));
}

/// The names of marks, along their lines.
function marks(c) {
  return c.marks.map(([x, text]) => ({
    x, y: 1, yref: "paper", text: escape(text), showarrow: false, xanchor: "left", yanchor: "top", textangle: 90, font: { size: 11 },
  }));
}

/// The names of rows above them, where there is no room on their left.
function rows(c) {
  return c.y.names.map((name, y) => ({
    x: 0, xref: "paper", y, text: rich(name), showarrow: false, xanchor: "left", yanchor: "bottom", yshift: 6, font: { size: 12 },
  }));
}

/// Below this width a chart is drawn as for a phone, pixels.
const NARROW = 560;

/// Pixels above and below the plot.
const ABOVE = 34, BELOW = 58;

/// Whether the page is being printed.
const on_paper = () => document.documentElement.classList.contains("paper");

/// Draws a chart into its place, as wide as that is now. The buttons stand above all else; the legend
/// stands below it and adds to the height.
function draw(place, c) {
  const narrow = place.clientWidth < NARROW;
  place.style.height = "";
  const height = place.clientHeight;
  const x = axis(c, "x", place.clientWidth), y = axis(c, "y", height - ABOVE - BELOW);
  if (c.x.scale === "equal") y.scaleanchor = "x";
  const named = narrow && c.y.names.length > 0;
  if (named) y.showticklabels = false;
  const layout = (legend) => ({
    xaxis: x, yaxis: y, hovermode: "closest", hoverdistance: 40, uirevision: c.id,
    width: place.clientWidth, height: height + legend,
    margin: { l: narrow ? 44 : 70, r: narrow ? 8 : 20, t: ABOVE, b: BELOW + legend }, paper_bgcolor: "#fff", plot_bgcolor: "rgba(0,0,0,0)",
    font: { family: "inherit", size: narrow ? 12 : 13, color: "#1f2a33" },
    legend: { orientation: "h", x: 0, xanchor: "left", yref: "container", y: 0, yanchor: "bottom", maxheight: 4 * height, bgcolor: "rgba(0,0,0,0)" },
    modebar: { bgcolor: "rgba(0,0,0,0)" },
    annotations: [...limits(c), ...marks(c), ...(named ? rows(c) : [])],
    shapes: c.marks.map(([at]) => ({ type: "line", x0: at, x1: at, y0: 0, y1: 1, yref: "paper", line: { color: "#9aa5ad", width: 1 } })),
  });
  const config = { displaylogo: false, scrollZoom: false, modeBarButtons: [["toImage", "zoom2d", "pan2d", "resetScale2d"]], toImageButtonOptions: { format: "svg", filename: c.id } };
  // Paper cannot be clicked: there, what is hidden is not listed.
  const hidden = (i) => on_paper() && place._fullData?.[i].visible === "legendonly";
  const traces = c.series.map((s, i) => ({ ...trace(s, c), ...(hidden(i) ? { showlegend: false } : {}) }));
  // First with room for a long legend, whose height is not known before it is drawn.
  Plotly.react(place, traces, layout(2 * height), config);
  const legend = place.querySelector(".legend .bg");
  const more = legend ? Math.ceil(legend.getBoundingClientRect().height) : 0;
  place.style.height = `${height + more}px`;
  Plotly.react(place, traces, layout(more), config);
}

/// Draws the charts that `host` has places for.
function draw_charts(host, charts) {
  for (const place of host.querySelectorAll("[data-chart]")) draw(place, charts.find((one) => one.id === place.dataset.chart));
}

// ---- sections of one machine

const of_kind = (m, kind) => m.modes.modes.filter((mode) => mode.kind === kind).map((mode) => mode.hz);

function charts_of(m, ...ids) {
  return `<div class="figures">${ids.map((id) => m.charts.find((c) => c.id === id)).filter(Boolean).map(chart).join("")}</div>`;
}

function waiting(m) {
  return m.closed ? "" : `<p class="warning">No closed loop: ${escape(m.missing)}</p>`;
}

function warned(warnings) {
  return warnings.map((w) => `<p class="warning">Warning: ${escape(w)}</p>`).join("");
}

function glance(m) {
  const suspension = of_kind(m, "suspension"), internal = of_kind(m, "internal");
  const cards = [];
  if (suspension.length) cards.push([from_to(suspension), has_control(m) ? "suspension modes without control" : "suspension modes"]);
  if (internal.length) cards.push([from_to(internal), "internal modes"]);
  const card = ([value, text]) => `<div class="card"><b>${value}</b><span>${text}</span></div>`;
  if (!has_control(m)) {
    const mass = [...m.scene.bodies, ...m.scene.point_masses].reduce((sum, part) => sum + part.mass, 0);
    cards.push([`${short(mass)} kg`, "rigid bodies and point masses"]);
    return `<p>The file says nothing of control: this page shows its parts and its modes.</p><div class="cards">${cards.map(card).join("")}</div>`;
  }
  let words = `This machine stands on six stiff legs. Without control it follows the floor and resonates at its suspension modes, ${from_to(suspension)}.`;
  if (m.closed) {
    const s = m.closed.design.shaped;
    cards.push([`${fixed(s.isolation_from_hz, 2)} Hz`, `isolates above this frequency (target ${short(m.frequency_hz)} Hz, damping ${short(m.damping)})`]);
    for (const band of s.bands) {
      cards.push([`${fixed(band.open_db)} → ${fixed(band.sampled_db)} dB`, `worst gain from floor to performance, without → with control, ${escape(band.name)}, ${short(band.low_hz)} to ${short(band.high_hz)} Hz`]);
    }
    cards.push([fixed(s.peak_sensitivity.value, 2), `peak sensitivity; 1 is no amplification, 2 the usual bound${s.drawn ? `; stable on ${s.drawn.stable} of ${s.drawn.samples} randomly perturbed machines` : ""}`]);
    const f = m.closed.floor;
    cards.push([f.open.criterion ?? "none", "vibration criterion that the frame meets without control"]);
    cards.push([f.closed.criterion ?? "none", "vibration criterion that the frame meets with control"]);
    cards.push([escape(f.floor), "floor for these two: its vibration is at the limit of this criterion"]);
    words += ` With ${m.feedback} feedback, sampled at ${short(m.sample_rate / 1000)} kHz with ${fixed(1e6 * m.closed.design.delay.whole, 0)} µs of delay, it moves as if it hung on soft springs and isolates from ${fixed(s.isolation_from_hz, 2)} Hz.`;
  }
  const warnings = [...m.warnings];
  if (m.closed && !m.closed.design.shaped.soft_start) warnings.push("the loop is not stable at every gain of the soft start");
  if (m.closed) warnings.push(...m.closed.floor.warnings.map((w) => `on the floor ${m.closed.floor.floor}, ${w}`));
  const said = warnings.length
    ? warned(warnings)
    : m.closed ? `<p class="good">The sampled loop is ${m.closed.poles.stable ? "stable" : "unstable"}; no warnings.</p>` : "";
  return `<p>${words}</p>${waiting(m)}<div class="cards">${cards.map(card).join("")}</div>${said}${charts_of(m, "session")}`;
}

/// Whether the file of the machine says anything of control.
const has_control = (m) => m.feedback !== undefined;

function machine(m) {
  const part_of = (rgb, text) => swatch(`#${rgb.toString(16).padStart(6, "0")}`, text);
  const legs = m.scene.beams.filter((beam) => beam.channel !== null);
  const part = (mode) => {
    const own = mode.strain.filter(({ name }) => legs.some((leg) => leg.name === name));
    return `${fixed(100 * own.reduce((sum, { share }) => sum + share, 0))} %`;
  };
  const rows = m.modes.modes.map((mode, i) => [i + 1, fixed(mode.hz, 3), mode.kind, short(mode.modal_mass), ...(legs.length ? [part(mode)] : []),
    ...mode.kinetic.map((k) => `${fixed(100 * k.share)} %`)]);
  const head = ["#", "Hz", "kind", "modal mass, kg", ...(legs.length ? ["strain energy in legs"] : []), ...m.modes.modes[0].kinetic.map((k) => `kinetic, ${escape(k.name)}`)];
  const loads = m.modes.leg_loads.map((l) => [escape(l.beam), fixed(l.axial_force), l.buckling_load === null ? "–" : fixed(l.buckling_load)]);
  const scene = m.scene;
  const parts = [[legs, LEG, "leg"], [legs, PIEZO, "actuator"], [scene.force_sensors, FORCE, "force sensor"], [scene.accelerometers, ACCELERATION, "accelerometer"],
    [scene.beams.filter((beam) => beam.channel === null), BEAM, has_control(m) ? "other beam" : "beam"], [scene.nodes.filter((node) => node.body === null && !node.free), FLOOR, has_control(m) ? "floor input, foot" : "foot"],
    [scene.springs, SPRING, "spring, joint"], [scene.point_masses, MASS, "point mass"]];
  return `<p class="controls">Drag to rotate, scroll to zoom, point at a part to see its data.</p>
    <div class="view"><div class="stage" id="scene"></div><div id="energies"></div></div>
    <div class="controls"><button id="play" aria-pressed="true">moving</button><button id="rest">at rest</button>
      <label>amplitude <input id="amplitude" type="range" min="0.01" max="0.2" step="0.005" value="0.08"></label>
      <label><input id="names" type="checkbox" checked> names</label></div>
    <div class="legend">${parts.filter(([list]) => list.length).map(([, rgb, text]) => part_of(rgb, text)).join("")}</div>
    <h3>Modes</h3><p class="note">Shown in slow motion and strongly magnified. A suspension mode has its strain energy in ${has_control(m) ? "the legs" : "what stands on the base"}, an internal mode between the bodies.</p>
    <div class="gallery" id="gallery"></div>${table(head, rows)}
    ${has_control(m) ? `<p class="note">Modes of the design model (${m.modes.reduction}); the gains are designed for these: ${m.modes.rigid_modes_hz.map((hz) => fixed(hz, 2)).join(", ")} Hz.</p>` : ""}
    ${loads.length ? `<h3>Under gravity</h3>${table(["beam", "axial force, N", "buckling load, N"], loads)}` : ""}`;
}

function response(m) {
  const missing = m.not_shown.length ? `<p class="note">Not shown: ${m.not_shown.map(escape).join("; ")}.</p>` : "";
  let tables = "";
  if (m.closed) {
    const d = m.closed.design;
    const bands = d.shaped.bands.map((b) => [escape(b.name), `${short(b.low_hz)} to ${short(b.high_hz)}`, fixed(b.open_db), fixed(b.ideal_db), fixed(b.sampled_db), fixed(b.sampled_db - b.ideal_db)]);
    const isolation = d.modes.flatMap((mode, k) => [["open", mode.open], ["ideal", mode.ideal], ["sampled", mode.sampled]].map(([name, i]) =>
      i ? [`${k + 1}, ${fixed(mode.hz, 2)} Hz`, name, fixed(i.corner_hz, 2), `${fixed(i.peak_db)} at ${fixed(i.peak_hz, 2)} Hz`, ...i.db.map((x) => fixed(x))]
        : [`${k + 1}, ${fixed(mode.hz, 2)} Hz`, name, "unstable", ...Array(1 + d.isolation_at_hz.length).fill("")]));
    tables = `${table([rich("highest peak of σ_max(G11)"), "Hz", "open, dB", "ideal, dB", "sampled, dB", "sampled minus ideal, dB"], bands)}
      ${charts_of(m, "isolation")}<h3>How each mode follows the floor motion in its own shape</h3><p class="note">Attenuation, dB, at the frequencies given.</p>
      ${table(["mode", "", "isolates from, Hz", "peak, dB", ...d.isolation_at_hz.map((hz) => `${hz} Hz`)], isolation, 2)}`;
  }
  return `${waiting(m)}${charts_of(m, "sigma")}${missing}${m.closed ? tables : charts_of(m, "isolation")}`;
}

function compliance(m) {
  if (!m.compliance) return "";
  const side = (highest) => (highest ? [short(highest.magnitude, 3), highest.magnitude ? short(highest.hz, 3) : "–"] : ["–", "–"]);
  const rows = m.compliance.loads.flatMap((load) => load.outputs.map((o, i) =>
    [i ? "" : `${load.unit} of ${escape(load.name)}`, escape(o.name), o.unit, short(Math.abs(o.fixed), 3), ...side(o.open_highest), ...side(o.closed_highest)]));
  const charts = m.charts.filter((c) => c.id.startsWith("compliance_"));
  return `<p>How far forces and moments on the machine displace it. At rest, control changes nothing, since it does not act on constant accelerations.</p>
    ${charts_of(m, ...charts.map((c) => c.id))}${table(["per", "", "unit", "at rest", "highest, open", "at Hz", "highest, closed", "at Hz"], rows, 3)}`;
}

function zeros(m) {
  const tables = m.zeros.kinds.map((kind) => {
    const rows = kind.zeros.map((z) => [fixed(z.hz, 3), fixed(z.damping, 4), fixed(z.nearest_closed_loop_hz, 3)]);
    const warning = kind.unstable ? `<p class="warning">A zero is unstable: the machine with its sensor outputs held at zero is unstable, and no gain of this kind of feedback can stabilise it.</p>` : "";
    return `<div><h3>Zeros, ${kind.feedback} feedback</h3>${warning}${table(["zero, Hz", "damping", "nearest ideal pole, Hz"], rows, 0)}</div>`;
  });
  let poles = "";
  if (m.closed) {
    const p = m.closed.poles;
    const cell = (list, i) => (list[i] ? [fixed(list[i].hz, 4), fixed(list[i].damping, 4)] : ["", ""]);
    const rows = Array.from({ length: Math.max(p.open.length, p.ideal.length, p.sampled.length) }, (_, i) => [...cell(p.open, i), ...cell(p.ideal, i), ...cell(p.sampled, i)]);
    poles = `<details><summary>All poles, ${m.feedback} feedback</summary>${table(["open, Hz", "damping", "ideal, Hz", "damping", "sampled, Hz", "damping"], rows, 0)}</details>`;
  }
  return `${charts_of(m, "frequencies")}<div class="columns">${tables.join("")}</div>${poles}`;
}

function loop(m) {
  if (!m.closed) return waiting(m);
  const d = m.closed.design, s = d.shaped;
  const p = s.peak_sensitivity;
  let shaping;
  if (s.shaping.modes) {
    const rows = s.shaping.modes.shapes.flatMap((x, i) => x.sections.map(({ zeros, poles }, j) => [j ? "" : i + 1, short(zeros.hz), fixed(zeros.damping, 3), short(poles.hz), fixed(poles.damping, 3), j ? "" : x.split_hz === null ? "–" : short(x.split_hz)]));
    shaping = table(["mode", "zeros, Hz", "damping", "poles, Hz", "damping", "split, Hz"], rows);
  } else {
    shaping = `<p>All channels have a low-pass at ${short(s.shaping.common.corner_hz)} Hz.</p>`;
  }
  const margins = [...d.margins.modes.map((x, i) => [`mode ${i + 1}`, x]), ["all modes at once", d.margins.together]];
  const b = d.margins.bode;
  return `${table(["peak sensitivity", ""], [["along the modes", `${fixed(p.value, 3)} at ${short(p.at)} Hz`], ["at the legs", fixed(p.at_legs, 3)], ["at the sensors", fixed(p.at_sensors, 3)],
      ...(s.drawn ? [["on randomly perturbed machines, at most", fixed(s.drawn.peak_sensitivity, 3)]] : []), ["slowest pole, 1/s", short(s.slowest_decay)]])}
    ${charts_of(m, "loop-gain", "sensitivity", "nyquist")}
    <h3>Disk margins</h3><p class="note">Changes of gain and phase, at the same time, that the loop tolerates before it is unstable.</p>
    ${table(["", "α", "gain", "phase"], margins.map(([name, x]) => [name, fixed(x.disk, 2), `×${fixed(x.gain, 2)}`, `±${fixed(x.phase_deg)}°`]))}
    <p class="note">Bode's integral, delay of ${b.delay_samples} sample${b.delay_samples === 1 ? "" : "s"}: ${fixed(b.attenuation_hz, 0)} Hz of attenuation cost ${fixed(b.amplification_hz, 0)} Hz of amplification, ${fixed((100 * b.amplification_hz) / b.limit_hz, 0)} % of what the bound allows.</p>
    <h3>Roll-off</h3><p class="note">The ideal gain is constant up to any frequency; with a delay this is unstable. So each mode has its own roll-off. AC coupling ${short(s.ac_coupling_hz)} Hz, leak ${short(s.leak_hz)} Hz.</p>${shaping}`;
}

const DELAYS = ["#0072b2", "#d55e00", "#009e73", "#cc79a7"];

function budgets(m) {
  if (!m.closed) return waiting(m);
  const d = m.closed.design.delay;
  const parts = [["sample to latch", d.latch], ["hold, half a period", d.hold], ["amplifier", d.amplifier], ["sensor", d.sensor]].filter(([, s]) => s > 0);
  const stack = parts.map(([name, s], i) => `<div style="width:${(100 * s) / d.whole}%;background:${DELAYS[i]}"></div>`).join("");
  const named = parts.map(([name, s], i) => swatch(DELAYS[i], `${name}, ${fixed(1e6 * s)} µs`)).join("");
  const f = m.closed.floor;
  const rms = f.closed.rms.map((r, i) => [escape(r.name), r.shown_unit, short(f.open.rms[i].shown_rms, 3), short(r.shown_rms, 3), ...r.shares.map((x) => `${fixed(100 * x)} %`)]);
  const rounding = m.closed.design.rounding.map((r) => [`${short(r.hz)} Hz`, fixed(r.over_noise_db, 0), fixed(r.codes_over_noise_db, 0)]);
  return `<h3>Delay: ${fixed(1e6 * d.whole)} µs in total</h3><div class="stack">${stack}</div><div class="legend">${named}</div>
    <h3>Sources of the motion</h3><p class="note">rms from ${short(f.low_hz)} to ${short(f.high_hz)} Hz, on a floor at the limit of ${escape(f.floor)}. The shares are those of the power with the loop closed.</p>
    ${table(["", "unit", "open", "closed", ...f.sources.map((s) => `from ${escape(s)}`)], rms, 2)}
    <h3>Rounding</h3><p class="note">Error from single precision and from the codes of the DAC, relative to sensor noise: below 0 dB it is less than the noise.</p>
    ${table(["at", "single precision, dB", "codes, dB"], rounding)}`;
}

function vibration(m) {
  if (!m.closed) return waiting(m);
  const f = m.closed.floor;
  const meets = (side) => side.criterion ?? "none of VC-A to VC-G";
  const rows = f.closed.thirds.map((t, i) => [fixed(t.hz), short(1e6 * f.open.thirds[i].velocity, 3), short(1e6 * t.velocity, 3), t.dominant]);
  return `<div class="together"><p>On a floor at the limit of ${escape(f.floor)}, the frame meets ${meets(f.open)} without control and ${meets(f.closed)} with control. A leg needs up to ${short(f.legs.rms, 3)} N rms; three sigma are ${short(f.legs.three_sigma, 3)} N, the limit is ${short(f.legs.limit, 3)} N.</p>${warned(f.warnings)}${charts_of(m, "vibration", "spectrum")}</div>
    <details><summary>One-third octaves</summary>${table(["Hz", "open, µm/s", "closed, µm/s", "main source, closed"], rows, 0)}</details>`;
}

function time(m) {
  if (!m.closed) return waiting(m);
  const s = m.closed.simulation;
  const rows = s.outputs.map((name, i) => [escape(name), short(s.open.rms[i], 3), short(s.closed.rms[i], 3), short(s.open.peak[i], 3), short(s.closed.peak[i], 3), fixed(20 * Math.log10(s.closed.rms[i] / s.open.rms[i]))]);
  return `${charts_of(m, "close-up", "forces")}<h3>${short(s.duration_s)} s of the closed loop</h3>
    <p class="note">Floor of ${short(s.floor_rms)} m/s² rms along each of x, y and z, ${s.floor_band_hz.map((x) => short(x)).join(" to ")} Hz, seed ${s.seed}. Of ${s.closed.steps} steps, ${s.closed.clamped_steps} with the clamp active and ${s.closed.railed_steps} with a sensor at a rail. Largest force ${fixed(s.closed.force_peak)} N.</p>
    ${table(["m/s²", "rms open", "rms closed", "peak open", "peak closed", "rms, dB"], rows)}`;
}

function gains(m) {
  const first = m.gains[0];
  const pair = (g) => {
    const [p, i] = g.feedback === "force" ? ["K_P, Eq. (22)", "K_I, 1/s, Eq. (22)"] : ["K_a, N/(m/s²), Eq. (19)", "K_v, N/(m/s), Eq. (20)"];
    return `${matrix(`${p}, ${g.feedback} feedback`, g.proportional, g.sensors, g.actuators)}${matrix(`${i}, ${g.feedback} feedback`, g.integral, g.sensors, g.actuators)}`;
  };
  const sensing = (g) => matrix(`T_c, Eq. (15), ${g.feedback} feedback`, g.sensing);
  return `<p>The ideal gains for ${short(m.frequency_hz)} Hz and damping ${short(m.damping)}. Rows of ${rich("K_a and K_v, K_P and K_I")} are legs, columns are sensors. The colour shows the magnitude: blue is positive, orange negative. The board runs them mode by mode, with the roll-off above.</p>
    <div class="columns">${m.gains.map(pair).join("")}${m.gains.map(sensing).join("")}</div><details><summary>The design model</summary><div class="columns">
    ${matrix("M_d, kg, Eq. (13)", first.mass, first.actuators, first.actuators)}${matrix("K_d, N/m, Eq. (13)", first.stiffness, first.actuators, first.actuators)}${matrix("S, 1/√kg, Eq. (17)", first.modal, null, first.actuators)}</div></details>`;
}

function assumptions(m) {
  const rows = m.statements.map((s) => [s.kind, escape(s.from), s.entries.map((e) => `<code>${escape(e)}</code>`).join(", ")]);
  const none = `<p class="warning">The file does not state the source of its numbers: see [[provenance]] in docs/machine-file.md.</p>`;
  const model = ["Small motions about the position given in the file; rigid bodies, and elastic ones and beams with mass where the file gives them.", "The base is rigid; its six inputs determine its motion. A floor vibrates along x, y and z, independently.", "Between samples, the acceleration of the floor is linear in time and the outputs are held.", "Sensors and amplifiers are first-order lags where the file gives their bandwidth; the hysteresis of the piezos is not in the model.",
    m.modes.leg_loads.length ? "Gravity is included, and static loads change the stiffness." : "Gravity is not included: the file does not give it."];
  return `${rows.length ? table(["", "source", "numbers"], rows, 3) : none}<h3>Assumptions of the model</h3><ul>${model.map((x) => `<li>${x}</li>`).join("")}</ul>`;
}

function file(m) {
  return m.files.map((f) => `<details><summary>${escape(f.path)}</summary><pre>${escape(f.text)}</pre></details>`).join("") +
    table(["", ""], [...(has_control(m) ? [["model, SHA-256", `<code>${m.model_sha256}</code>`]] : []), ...(m.closed ? [["checksum of the table", `<code>${m.closed.table_checksum.toString(16).padStart(8, "0")}</code>, format ${m.closed.table_format}`]] : []),
      ["host-gen", review.version], ["charts, 3D", `plotly.js ${Plotly.version}, three.js ${THREE.REVISION}`]], 2);
}

const SECTIONS = [
  ["glance", "At a glance", glance], ["machine", "The machine", machine], ["response", "From the floor", response], ["compliance", "Under loads", compliance], ["zeros", "Zeros", zeros],
  ["loop", "The loop", loop], ["budgets", "Budgets", budgets], ["vibration", "Vibration", vibration], ["time", "In time", time],
  ["gains", "Gains", gains], ["assumptions", "Assumptions", assumptions], ["file", "File and versions", file],
];

/// The sections of a machine whose file says nothing of control.
const PASSIVE = ["glance", "machine", "file"];

// ---- machines side by side

function side_by_side(both) {
  const { names, differences } = both;
  const columns = both.compared.machines;
  const list = (key) => columns.map((c) => c[key].map((hz) => fixed(hz, 2)).join(", ") || "–");
  const shaped = (cell) => columns.map((c) => (c.shaped ? cell(c.shaped) : "unreachable"));
  const bands = [...new Set(columns.flatMap((c) => (c.shaped ? c.shaped.bands.map((b) => b.name) : [])))];
  const loads = [...new Map(columns.flatMap((c) => c.compliance.map(({ load, unit }) => [`${load} ${unit}`, [load, unit]]))).values()];
  const level = (name, key) => shaped((s) => fixed(s.bands.find((b) => b.name === name)?.[key]));
  const rows = [
    ["feedback", ...columns.map((c) => c.feedback)],
    ["suspension modes, Hz", ...list("suspension_hz")], ["internal modes, Hz", ...list("internal_hz")],
    ["zeros, acceleration feedback, Hz", ...list("acceleration_zeros_hz")], ["zeros, force feedback, Hz", ...list("force_zeros_hz")],
    ["largest proportional gain", ...columns.map((c) => short(c.largest_gain))],
    ["peak sensitivity", ...shaped((s) => fixed(s.peak_sensitivity.value, 3))],
    ["isolates from, Hz", ...shaped((s) => fixed(s.isolation_from_hz, 2))],
    ...bands.flatMap((name) => [["open", "open_db"], ["ideal", "ideal_db"], ["sampled", "sampled_db"]].map(([what, key]) => [rich(`σ_max(G11), ${name}, ${what}, dB`), ...level(name, key)])),
    ...loads.flatMap(([load, unit]) => [["at rest", (own) => own.at_rest], ["highest, open", (own) => own.open_highest.magnitude], ["highest, closed", (own) => own.closed_highest?.magnitude]].map(([what, value]) => [
      `compliance to ${escape(load)}, ${what}, ${unit}`, ...columns.map((c) => {
        const own = c.compliance.find((own) => own.load === load && own.unit === unit);
        return own ? short(value(own), 3) : "–";
      })])),
  ].filter(([, ...cells]) => cells.some((cell) => cell !== "–"));
  const unequal = ([, ...cells]) => cells.some((cell) => cell !== cells[0]);
  const settings = differences.map(([key, values]) => [`<code>${escape(key)}</code>`, ...values.map((v) => (v === null ? "–" : `<code>${escape(v)}</code>`))]);
  return `<section id="compared"><h2>Side by side</h2><p class="note">Rows with unequal values are marked.</p>${table(["", ...names.map(escape)], rows, 1 + names.length, unequal)}
    <h3>Settings that differ</h3>${settings.length ? table(["", ...names.map(escape)], settings, 1 + names.length) : "<p>None: the files are equivalent.</p>"}
    <div class="figures">${both.charts.map(chart).join("")}</div></section>`;
}

// ---- the page

function three_d(m) {
  const host = document.getElementById("scene");
  const energies = document.getElementById("energies");
  const gallery = document.getElementById("gallery");
  if (!document.createElement("canvas").getContext("webgl2")) {
    host.textContent = "The 3D view needs WebGL 2, which this browser does not support.";
    return;
  }
  stage?.end();
  stage = new Stage(host, m);
  const pictures = stage.pictures();
  gallery.innerHTML = m.modes.modes.map((mode, i) => `<button data-mode="${i}"><img src="${pictures[i]}" alt="mode ${i + 1}">${i + 1}: ${fixed(mode.hz, 2)} Hz<small>${mode.kind}</small></button>`).join("");
  const show = (index) => {
    stage.show(index);
    chosen.mode = index ?? chosen.mode;
    for (const button of gallery.children) button.setAttribute("aria-pressed", Number(button.dataset.mode) === index);
    const mode = m.modes.modes[index];
    energies.innerHTML = index === null ? "" : `<b>Mode ${index + 1}: ${fixed(mode.hz, 3)} Hz</b><br>${mode.kind}, modal mass ${short(mode.modal_mass)} kg${bars("Strain energy", mode.strain)}${bars("Kinetic energy", mode.kinetic)}`;
  };
  gallery.addEventListener("click", (event) => {
    const button = event.target.closest("button");
    if (button) show(Number(button.dataset.mode));
  });
  const play = document.getElementById("play");
  play.onclick = () => {
    stage.playing = !stage.playing;
    play.setAttribute("aria-pressed", stage.playing);
    play.textContent = stage.playing ? "moving" : "still";
  };
  document.getElementById("rest").onclick = () => show(null);
  document.getElementById("amplitude").oninput = (event) => {
    stage.amplitude = Number(event.target.value);
    stage.pose(stage.factor);
  };
  document.getElementById("names").onchange = (event) => stage.names(event.target.checked);
  show(Math.min(chosen.mode, m.modes.modes.length - 1));
  stage.run();
}

/// What is looked at: kept when the page is drawn again.
const chosen = { machine: 0, mode: 0 };
let stage = null;

function show_machine(index) {
  const m = review.machines[index];
  chosen.machine = index;
  const host = document.getElementById("sections");
  for (const place of host.querySelectorAll("[data-chart]")) Plotly.purge(place);
  // What the machine has nothing for is left out.
  const known = SECTIONS.filter(([id]) => has_control(m) || PASSIVE.includes(id));
  const sections = known.map(([id, title, body]) => [id, title, body(m)]).filter(([, , text]) => text);
  host.innerHTML = sections.map(([id, title, text]) => `<section id="${id}"><h2>${title}</h2>${text}</section>`).join("");
  const links = [...(review.side_by_side ? [["compared", "Side by side"]] : []), ...sections];
  document.getElementById("contents").innerHTML = links.map(([id, title]) => `<a href="#${id}">${title}</a>`).join("");
  draw_charts(host, m.charts);
  three_d(m);
  for (const [i, button] of [...document.querySelectorAll(".tabs button")].entries()) button.setAttribute("aria-pressed", i === index);
}

function start() {
  const both = review.side_by_side;
  const names = both ? both.names : review.machines.map((m) => m.machine);
  document.title = `${names.join(", ")} · hardmount`;
  document.getElementById("title").textContent = names.join(" · ");
  const [m] = review.machines;
  document.getElementById("subtitle").textContent = both
    ? `${names.length} machines on six hard mounts, side by side`
    : !has_control(m) ? "A machine without control."
    : `A machine on six hard mounts, ${m.feedback} feedback for ${short(m.frequency_hz)} Hz. Model ${m.model_sha256.slice(0, 12)}.`;
  const tabs = both ? `<div class="tabs">${names.map((n, i) => `<button data-machine="${i}">${escape(n)}</button>`).join("")}</div>` : "";
  const main = document.getElementById("main");
  main.innerHTML = `${both ? side_by_side(both) : ""}${tabs}<div id="sections"></div>`;
  if (both) {
    draw_charts(document.getElementById("compared"), both.charts);
    main.querySelector(".tabs").onclick = (event) => {
      const button = event.target.closest("button");
      if (button) show_machine(Number(button.dataset.machine));
    };
  }
  document.getElementById("footer").textContent = `hardmount ${review.version}. Equation numbers are those of J. van Dijk, "Mechatronic Design of Hard-Mount Concepts for Precision Equipment".`;
  show_machine(Math.min(chosen.machine, review.machines.length - 1));
}

/// Another review in place of this one, or what is wrong with the file.
function update(next, error) {
  if (next) {
    review = next;
    start();
  }
  document.getElementById("error")?.remove();
  if (error) {
    const bar = document.createElement("div");
    bar.id = "error";
    bar.textContent = error;
    document.body.append(bar);
  }
}

/// All charts again, in the width that they have now.
function draw_again() {
  const both = document.getElementById("compared");
  if (both) draw_charts(both, review.side_by_side.charts);
  draw_charts(document.getElementById("sections"), review.machines[chosen.machine].charts);
}

let width = window.innerWidth;
window.addEventListener("resize", () => {
  if (window.innerWidth === width) return;
  width = window.innerWidth;
  draw_again();
});
// Paper is narrower than the screen, and shows what is folded.
window.addEventListener("beforeprint", () => {
  document.querySelectorAll("details:not(#file details)").forEach((fold) => (fold.open = true));
  document.documentElement.classList.add("paper");
  draw_again();
  stage?.resize();
});
window.addEventListener("afterprint", () => {
  document.documentElement.classList.remove("paper");
  draw_again();
  stage?.resize();
});

start();
