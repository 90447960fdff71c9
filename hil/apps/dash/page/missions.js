// Missions of the user: a file to upload, or a course that is drawn on the ground of the 3-D view.

const NEAR_TOP = 1.5; // pitch of the view, rad

export class Missions {
  // `bar`: elements of the form under the view. `home()`: where the vehicle starts. `onMission(path)`: a mission is in the list of the server now.
  constructor({ view, follow, file, draw, bar, home, message, onMission }) {
    Object.assign(this, { view, follow, draw, bar, home, message, onMission });
    this.points = []; // east, north [m]
    this.ground = 0; // height at which they are drawn [m]
    file.onchange = async () => {
      const [chosen] = file.files;
      file.value = ""; // the same file can be chosen again
      if (chosen) await this.send(`/api/missions/file?name=${encodeURIComponent(chosen.name)}`, chosen);
    };
    draw.onclick = () => this.open(bar.box.hidden);
    bar.undo.onclick = () => this.change(this.points.slice(0, -1));
    bar.clear.onclick = () => this.change([]);
    bar.close.onclick = () => this.open(false);
    bar.use.onclick = () => this.use();
    bar.home.onchange = bar.height.oninput = () => this.change(this.points);
  }

  open(on) {
    this.bar.box.hidden = !on;
    this.draw.setAttribute("aria-pressed", String(on));
    this.view.onTap = on ? (x, y) => this.tap(x, y) : null;
    if (on) {
      this.ground = this.home()[2];
      this.view.follow = false;
      this.follow.setAttribute("aria-pressed", "false");
      if (this.view.pitch < NEAR_TOP) this.view.look(-Math.PI / 2, 1.55, Math.max(this.view.distance, 70));
    }
    this.change(on ? this.points : []);
  }

  tap(x, y) {
    const at = this.view.groundAt(x, y, this.ground);
    if (at) this.change([...this.points, at]);
  }

  change(points) {
    this.points = points;
    const height = this.ground + (Number(this.bar.height.value) || 0),
      home = this.home().slice(0, 2),
      course = [home, ...points, ...(this.bar.home.checked ? [home] : [])];
    const lengths = course.slice(1).map((p, k) => Math.hypot(p[0] - course[k][0], p[1] - course[k][1]));
    const length = lengths.reduce((sum, value) => sum + value, 0);
    this.bar.text.textContent = points.length
      ? `${points.length} waypoint${points.length > 1 ? "s" : ""}, ${length.toFixed(0)} m`
      : "tap the ground to set waypoints";
    this.bar.use.disabled = this.bar.undo.disabled = this.bar.clear.disabled = !points.length;
    const at = (p) => [p[0], p[1], height];
    this.view.setLine("draft", points.length ? course.flatMap(at) : [], { colour: "--plan" });
    this.view.setLine("draft corners", points.flatMap(at), { colour: "--plan", mode: this.view.gl?.POINTS, size: 9 });
  }

  async use() {
    const course = {
      points_m: this.points,
      height_m: Number(this.bar.height.value),
      speed_mps: Number(this.bar.speed.value),
      land_at_start: this.bar.home.checked,
    };
    if (await this.send("/api/missions/drawn", JSON.stringify(course))) this.open(false);
  }

  // Send a mission to the server; return true if it took it.
  async send(url, body) {
    const answer = await fetch(url, { method: "POST", body });
    this.message(answer.ok ? "" : await answer.text());
    if (answer.ok) await this.onMission((await answer.json()).mission);
    return answer.ok;
  }
}
