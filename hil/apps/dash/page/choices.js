// The lists of the start form, with the values of the chosen bench as the first entries.

import { base, options } from "./panes/tables.js";
import { answered } from "./requests.js";

export class Choices {
  // `field(name)`: the form's element; `show(text)`: shows why the lists are missing.
  constructor(field, show) {
    Object.assign(this, { field, show });
    this.asked = 0;
  }

  async offer() {
    const bench = this.field("bench").value,
      asked = ++this.asked,
      newest = () => asked === this.asked; // else another bench was chosen meanwhile
    const answer = await answered(`/api/choices${bench ? `?bench=${encodeURIComponent(bench)}` : ""}`, (reason) => {
      if (newest()) this.show(`the lists of the form did not come (${reason}); asking again`);
    });
    if (!newest()) return;
    if (!answer.ok) {
      this.show(`${base(bench)}: its values did not come (${await answer.text()}); choose another bench`);
      return;
    }
    const lists = await answer.json();
    this.show("");
    for (const name of ["bench", "rig", "scene", "mission"]) {
      const own = lists.defaults[name];
      options(this.field(name), lists[name], {
        none: name === "bench" ? null : own ? `${base(own)} (the bench's)` : "the bench's (none)",
      });
    }
    this.field("seed").placeholder = lists.defaults.seed ?? "the bench's";
  }
}
