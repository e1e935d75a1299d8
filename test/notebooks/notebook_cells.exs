# Evaluates the cells of notebooks as Livebook does, in order and with the bindings of those before, and
# compares what a cell answers with the output that stands behind it. The first arguments are
# replacements in the text, FROM=TO, then the files. Says for each notebook how many cells have run,
# outputs were compared, and pictures shown.
defmodule Cells do
  @doc "The cells: {line, code, expected output or nil}."
  def of(text) do
    ~r/^```elixir\n(.*?)^```\n(?:\n<!-- livebook:\{"output":true\} -->\n\n```\n(.*?)^```\n)?/ms
    |> Regex.scan(text, return: :index)
    |> Enum.map(fn [{from, _}, code | output] ->
      line = text |> binary_part(0, from) |> String.split("\n") |> length()
      {line + 1, part(text, code), output |> Enum.map(&part(text, &1)) |> List.first()}
    end)
  end

  defp part(text, {from, length}), do: binary_part(text, from, length)

  @doc "A group leader that takes outputs as Livebook's does, and counts pictures."
  def leader(real, shown) do
    receive do
      {:io_request, from, ref, {:livebook_put_output, output}} ->
        send(from, {:io_reply, ref, :ok})
        leader(real, [output | shown])

      {:io_request, _, _, _} = request ->
        send(real, request)
        leader(real, shown)

      {:shown, from} ->
        send(from, {:shown, shown})
        leader(real, [])
    end
  end

  def run({line, code, expected}, {bindings, env, file}) do
    quoted = Code.string_to_quoted!(code, file: file, line: line)
    {value, bindings, env} = Code.eval_quoted_with_env(quoted, bindings, env)
    told = inspect(value, pretty: true, width: 98)

    if expected != nil and String.trim(expected) != told do
      IO.puts("#{file}:#{line}: the cell answers\n#{told}\nnot\n#{expected}")
      System.halt(1)
    end

    {bindings, env, file}
  end
end

{replacements, files} = Enum.split_with(System.argv(), &String.contains?(&1, "="))
Code.compiler_options(ignore_module_conflict: true)
real = Process.group_leader()

for file <- files do
  text =
    Enum.reduce(replacements, File.read!(file), fn pair, text ->
      [from, to] = String.split(pair, "=", parts: 2)
      String.replace(text, from, to)
    end)

  leader = spawn_link(fn -> Cells.leader(real, []) end)
  Process.group_leader(self(), leader)
  cells = Cells.of(text)
  Enum.reduce(cells, {[], Code.env_for_eval(file: file), file}, &Cells.run/2)
  Process.group_leader(self(), real)
  send(leader, {:shown, self()})

  shown =
    receive do
      {:shown, shown} -> shown
    end

  pictures =
    for %{type: type} = output <- shown,
        type in [:image, :frame, :frame_update],
        do: output |> inspect(printable_limit: :infinity, limit: :infinity) |> String.contains?("<svg")

  compared = Enum.count(cells, fn {_, _, output} -> output != nil end)

  IO.puts(
    "#{Path.basename(file)}: #{length(cells)} cells, #{compared} outputs, " <>
      "#{Enum.count(pictures, & &1)} of #{length(pictures)} pictures"
  )
end
