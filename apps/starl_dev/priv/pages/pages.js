// The search over guides and modules: each word must be in an entry; titles come before texts, guides
// and the modules that matter before the others. ENTRIES: [title, page, text, rank].
(function () {
  var field = document.getElementById("search");
  var list = document.getElementById("found");
  function score(entry, words) {
    var title = entry[0].toLowerCase(), all = title + " " + entry[2].toLowerCase(), sum = 10 * entry[3];
    for (var i = 0; i < words.length; i++) {
      if (all.indexOf(words[i]) < 0) return -1;
      sum += title.indexOf(words[i]) < 0 ? 40 : title.indexOf(words[i]) > 0 ? 5 : 0;
    }
    return sum + title.length / 100;
  }
  function show() {
    var words = field.value.toLowerCase().split(/\s+/).filter(Boolean), hits = [];
    list.textContent = "";
    if (!words.length) return;
    ENTRIES.forEach(function (entry) {
      var s = score(entry, words);
      if (s >= 0) hits.push([s, entry]);
    });
    hits.sort(function (a, b) { return a[0] - b[0]; });
    hits.slice(0, 25).forEach(function (hit) {
      var item = document.createElement("li"), link = document.createElement("a"), text = document.createElement("small");
      link.textContent = hit[1][0];
      link.href = hit[1][1];
      text.textContent = hit[1][2].slice(0, 90);
      item.appendChild(link);
      item.appendChild(text);
      list.appendChild(item);
    });
    if (!hits.length) list.textContent = "nothing has all these words";
  }
  field.addEventListener("input", show);
  document.addEventListener("keydown", function (event) {
    if (event.key === "/" && document.activeElement !== field) { field.focus(); event.preventDefault(); }
  });
})();
