// Small tables, always as text: nothing from a run is ever taken for HTML.

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
  heads.forEach((text, k) => cell(head, text, { tag: "th", kind: k && rows.some((row) => typeof row[k] === "number") ? "num" : "" }));
  const body = rows.map((values) => {
    const row = document.createElement("tr");
    for (const value of values) cell(row, typeof value === "number" ? number(value) : value, { kind: typeof value === "number" || value === "–" ? "num" : "" });
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
  return value >= 1e6 ? `${(value / 1e6).toFixed(1)} MB` : value >= 1e3 ? `${(value / 1e3).toFixed(0)} kB` : `${value} B`;
}
