// Tables, lists and number formats. Everything is inserted as text, so no value of a run is interpreted as HTML.

export function cell(row, text, { tag = "td", kind = "", title = "" } = {}) {
  const made = document.createElement(tag);
  made.textContent = text ?? "";
  if (kind) made.className = kind;
  if (title) made.title = title;
  row.append(made);
  return made;
}

export function table(element, heads, rows) {
  const head = document.createElement("tr");
  heads.forEach((text, k) =>
    cell(head, text, { tag: "th", kind: k && rows.some((row) => typeof row[k] === "number") ? "num" : "" }),
  );
  const body = rows.map((values) => {
    const row = document.createElement("tr");
    for (const value of values)
      cell(row, typeof value === "number" ? number(value) : value, {
        kind: typeof value === "number" || value === "–" ? "num" : "",
      });
    return row;
  });
  element.replaceChildren(...(heads.length ? [head] : []), ...body);
}

export function number(value, digits = 2) {
  if (value === null || value === undefined || !Number.isFinite(value)) return "–";
  if (Number.isInteger(value)) return value >= 10000 ? value.toLocaleString("en") : String(value);
  const text = Math.abs(value) >= 100 ? value.toFixed(0) : value.toFixed(digits);
  return Number(text) === 0 ? text.replace("-", "") : text;
}

export function bytes(value) {
  return value >= 1e6
    ? `${(value / 1e6).toFixed(1)} MB`
    : value >= 1e3
      ? `${(value / 1e3).toFixed(0)} kB`
      : `${value} B`;
}

// The name of a file without folder and suffix.
export function base(path) {
  return (path ?? "")
    .split("/")
    .pop()
    .replace(/\.yaml$/, "");
}

// "6 of 6 waypoints", from run.json's mission or a live state; empty without waypoints.
export function reachedOf(mission) {
  return mission?.waypoints ? `${mission.reached} of ${mission.waypoints} waypoints` : "";
}

// Fill a list. The selection is kept if the list still has it.
export function options(select, values, { none = null, chosen = null } = {}) {
  const selected = chosen ?? select.value;
  select.replaceChildren();
  if (none !== null) select.append(new Option(none, ""));
  for (const value of values) select.append(new Option(base(value), value));
  if ([...select.options].some((option) => option.value === selected)) select.value = selected;
}

const FIX = ["no GPS", "no fix", "2-D fix", "3-D fix", "DGPS", "RTK float", "RTK fixed"];

// One row per sensor that measures numbers, with its newest values.
export function sensorRows(sensors) {
  return Object.entries(sensors ?? {})
    .sort(([a], [b]) => a.localeCompare(b))
    .map(([name, sample]) => [name, valuesOf(sample)]);
}

function valuesOf(s) {
  const vector = (v, unit, digits = 2) => `${v.map((value) => number(value, digits)).join(", ")} ${unit}`;
  if (s.accel_mps2) return `${vector(s.accel_mps2, "m/s²")}; ${vector(s.gyro_radps, "rad/s")}`;
  if (s.field_tesla)
    return vector(
      s.field_tesla.map((v) => v * 1e6),
      "µT",
      1,
    );
  if (s.pressure_altitude_m !== undefined)
    return `${number(s.pressure_pa / 100, 2)} hPa, ${number(s.pressure_altitude_m)} m`;
  if (s.fix_type !== undefined)
    return `${FIX[s.fix_type] ?? s.fix_type}, ${s.satellites} satellites, ±${number(s.horizontal_accuracy_m)} m; ${s.latitude_deg?.toFixed(6)}°, ${s.longitude_deg?.toFixed(6)}°, ${number(s.altitude_m)} m`;
  if (s.flow_rad) return `${vector(s.flow_rad, "rad", 3)}, quality ${s.quality}`;
  if (s.distance_m !== undefined) return s.quality ? `${number(s.distance_m)} m` : "nothing in range";
  return "";
}
