// Requests of what the page cannot do without.

const AGAIN_MS = 1000;

// Return the server's answer to a request, which is repeated until there is one. `onFailure` gets the reason of each
// failure. A refusal (status 4xx) is an answer, too: the next one would be the same.
export async function answered(url, onFailure) {
  for (;;) {
    try {
      const answer = await fetch(url);
      if (answer.status < 500) return answer;
      onFailure(`status ${answer.status}`);
    } catch (error) {
      onFailure(error.message); // no connection
    }
    await new Promise((resolve) => setTimeout(resolve, AGAIN_MS));
  }
}
