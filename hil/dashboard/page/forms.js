// Small helpers for what is chosen and what is called by its file.

// A file by its name alone.
export function base(path) { return (path ?? "").split("/").pop().replace(/\.yaml$/, ""); }

// Fill a list; what was chosen stays so, if it is still there.
export function options(select, values, { none = null, chosen = null } = {}) {
  const before = chosen ?? select.value;
  select.replaceChildren();
  if (none !== null) select.append(new Option(none, ""));
  for (const value of values) select.append(new Option(base(value), value));
  if ([...select.options].some((option) => option.value === before)) select.value = before;
}
