// The link to the station: alive by heartbeats that it answers, and made anew when it is not. Orders (commands and uploads) carry the
// newest of the station's stamps, by which it tells their age; each is answered, or has failed.

const BEAT_MS = 500;
const LOOK_MS = 100;
export const MAX_SILENT_MS = 2000;  // as long as the station takes an order
const RENEW_MS = 5000;  // a stalled connection is given up: a new one is through sooner than the old one's repetitions
const RETRY_MS = 1000;
const GAVE_WAY = 4001;  // station/outbox.py

const now = () => Math.round(performance.now());
const token = new URLSearchParams(location.search).get("token") ?? "";

// The address of something that the station gives to those who have the token.
export const withToken = (path) => `${path}?token=${encodeURIComponent(token)}`;

export class Link {
  // ``hear`` gets each message; ``opened`` is called when a connection has been made; ``changed`` with whether the link is alive, and how old
  // its newest proof is.
  constructor(hear, opened, changed) {
    Object.assign(this, { hear, opened, changed });
    this.socket = null;
    this.proven = now();  // when the newest heartbeat was sent that has been answered: what was shown then was no older
    this.stamp = null;
    this.waiting = null;  // since when an answer is waited for; null: none is
    this.orders = new Map();  // by number, until they are answered
    this.number = 0;
    this.refused = null;  // why the station refuses this page: "gave way" to another one, or "no token"
  }

  start() {
    this.#connect();
    setInterval(() => this.#beat(), BEAT_MS);
    setInterval(() => this.#look(), LOOK_MS);
    document.addEventListener("visibilitychange", () => this.#beat());  // the timers of a hidden page are slowed down
  }

  get isAlive() {
    return this.socket?.readyState === WebSocket.OPEN && this.stamp !== null && this.silentMs <= MAX_SILENT_MS;
  }

  get silentMs() {
    return now() - this.proven;
  }

  // Ask the station for something; whether there is one to ask.
  ask(wish) {
    if (this.socket?.readyState !== WebSocket.OPEN) return false;
    this.socket.send(JSON.stringify(wish));
    return true;
  }

  // Give an order; whether it is sent: by a link that is not alive nothing is. ``outcome`` is called with what becomes of it: "sent", "refused",
  // "failed" (no answer in time) or, after that, "late".
  order(wish, outcome) {
    if (!this.isAlive) return false;
    const number = ++this.number;
    const order = { outcome, failed: false };
    this.orders.set(number, order);
    setTimeout(() => {
      if (!this.orders.has(number)) return;
      order.failed = true;
      outcome("failed");
    }, MAX_SILENT_MS);
    return this.ask({ ...wish, number, stamp: this.stamp });
  }

  #connect() {
    const socket = new WebSocket(`${location.protocol === "https:" ? "wss" : "ws"}://${location.host}/${withToken("socket")}`);
    Object.assign(this, { socket, stamp: null, waiting: now() });
    const isCurrent = () => this.socket === socket;
    socket.addEventListener("open", () => {
      if (!isCurrent()) return;
      this.refused = null;
      this.opened();
      this.#beat();
    });
    socket.addEventListener("message", (message) => {
      if (isCurrent()) this.#receive(JSON.parse(message.data));
    });
    socket.addEventListener("close", (event) => {
      if (!isCurrent()) return;
      if (event.code === GAVE_WAY) this.refused = "gave way";
      else setTimeout(() => this.socket === null && this.#connect(), RETRY_MS);
      if (this.stamp === null) this.#askWhy();
      this.#drop();
    });
  }

  // A browser does not tell a page why its socket was refused; the answer to another request does.
  async #askWhy() {
    const answer = await fetch(withToken("layer.json")).catch(() => null);
    if (answer) this.refused = answer.status === 403 ? "no token" : null;
  }

  #drop() {
    this.socket = null;
    this.#look();
  }

  #beat() {
    if (this.ask({ beat: now() })) this.waiting ??= now();
  }

  #receive(said) {
    if (said.kind === "beat") {
      this.proven = Math.max(this.proven, said.beat);
      Object.assign(this, { stamp: said.stamp, waiting: null });
      this.#look();
    } else if (said.kind === "answer") this.#answered(said);
    else this.hear(said);
  }

  #answered({ number, refused }) {
    const order = this.orders.get(number);
    this.orders.delete(number);
    order?.outcome(refused ? "refused" : order.failed ? "late" : "sent", refused);
  }

  #look() {
    this.changed(this.isAlive, this.silentMs);
    if (this.socket && this.waiting !== null && now() - this.waiting > RENEW_MS) {
      const stalled = this.socket;
      this.#drop();
      stalled.close();
      this.#connect();
    }
  }
}
