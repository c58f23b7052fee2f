/* The search leaves out words that say nothing, as its index does, and shows the best pages only. */
(() => {
  const [QUERY, RESULT] = [2, 3]; // messages of the theme's worker
  const MOST_PAGES = 10;
  const STOPPED = `a able about across after all almost also am among an and any are as at be because been but by can
    cannot could dear did do does either else ever every for from get got had has have he her hers him his
    how however i if in into is it its just least let like likely may me might most must my neither no nor
    not of off often on only or other our own rather said say says she should since so some than that the
    their them then there these they this tis to too twas us wants was we were what when where which while
    who whom why will with would yet you your`;
  const ASKING = `find need put use using want write`; // left out of questions that have other words
  const keep = (words, left) => {
    const leave = new Set(left.split(/\s+/));
    return words.filter((word) => !leave.has(word.toLowerCase().replace(/[^\p{L}\p{N}]+$/u, "")));
  };
  const shorten = (query) => {
    const words = keep(query.split(/\s+/), STOPPED);
    return (keep(words, ASKING).length ? keep(words, ASKING) : words).join(" ");
  };
  window.Worker = class extends window.Worker {
    constructor(...given) {
      super(...given);
      this.addEventListener("message", ({ data }) => {
        if (data.type === RESULT) data.data.items.splice(MOST_PAGES);
      });
    }

    postMessage(message, ...more) {
      const asked = message.type === QUERY;
      super.postMessage(asked ? { ...message, data: shorten(message.data) } : message, ...more);
    }
  };
})();
