// The report on demand: it may take a while, and it may be refused; both are told.

import { withToken } from "./link.js";
import { element, say } from "./texts.js";

export function offerReport() {
  const [button, told] = [document.getElementById("report"), document.getElementById("report-told")];
  let making = false;
  button.addEventListener("click", async (click) => {
    click.preventDefault();
    if (making) return;
    making = true;
    told.textContent = say("report making");
    told.textContent = await fetched(withToken("report.zip")).catch(() => say("report lost"));
    making = false;
  });
}

// Download the report; what there is to say of it.
async function fetched(address) {
  const answer = await fetch(address);
  if (!answer.ok) return say("report refused", { why: await answer.text() });
  const name = /filename="([^"]+)"/.exec(answer.headers.get("Content-Disposition"))?.[1] ?? "report.zip";
  const link = Object.assign(element("a"), { href: URL.createObjectURL(await answer.blob()), download: name });
  link.click();
  setTimeout(() => URL.revokeObjectURL(link.href), 60000);
  return say("report made", { name });
}
