# So that mix compiles this application without rebar3; see mix.exs at the top.
defmodule StarlNotebook.MixProject do
  use Mix.Project

  {:ok, [{:application, _, props}]} =
    :file.consult(String.to_charlist(Path.join(__DIR__, "src/starl_notebook.app.src")))

  # The modules lie in starl_lab, whose commands need libraries from Hex: mix compiles their folders alone.
  @props Keyword.update!(props, :applications, &(&1 -- [:starl_lab]))

  def project do
    [
      app: :starl_notebook,
      version: to_string(@props[:vsn]),
      language: :erlang,
      erlc_paths: ["../starl_lab/src/notebook", "../starl_lab/src/film"],
      deps: deps()
    ]
  end

  def application do
    Keyword.take(@props, [:applications, :description, :env, :mod, :registered])
  end

  # Starl.App, which programs in Elixir use, lies at the top.
  defp deps do
    [{:starl, path: "../.."}] ++
      for app <- @props[:applications],
          File.dir?(Path.join(__DIR__, "../#{app}")),
          do: {app, path: "../#{app}"}
  end
end
